"""Two detectors as one: each phrase goes to the one that knows its noun."""

from collections.abc import Callable, Sequence

from perception.catalogue.catalogue import Catalogue
from perception.catalogue.phrases import parse_phrase
from perception.errors import UnknownPhraseError
from perception.frames import RgbdFrame
from perception.interfaces import Detection, Detector, ShapeDetector


class DetectorRouter:
    """Nouns of the catalogue by colour and shape, other nouns by learned weights, what is left by its colour.

    The learned weights are loaded with the first phrase that needs them.

    Attributes:
        by_colour: For phrases with a noun that has an appearance in the catalogue, or with a colour.
        learned: For phrases with another noun.
    """

    def __init__(
        self,
        by_colour: Detector,
        learned: Detector,
        knows: Callable[[str], object],
        catalogue: Catalogue | None = None,
    ) -> None:
        """Put two detectors together.

        Args:
            by_colour, learned: The two.
            knows: Raises UnknownPhraseError for a phrase that `learned` has no way to look for.
            catalogue: Says which nouns have an appearance; the built-in one if None.
        """
        self.by_colour, self.learned, self._knows, self._catalogue = by_colour, learned, knows, catalogue

    @property
    def name(self) -> str:
        """Both, for a user has to know who answered."""
        return f"{self.by_colour.name}; for other nouns {self.learned.name}"

    def detect(self, frame: RgbdFrame, phrases: Sequence[str]) -> list[Detection]:
        """All boxes above the thresholds, best first.

        Raises:
            UnknownPhraseError: A phrase that neither of the two has a way to look for.
            ModelUnavailableError: A phrase needs the learned weights, and packages that run them are not there.
        """
        learned = [phrase for phrase in dict.fromkeys(phrases) if self.is_for_learned(phrase)]
        others = [phrase for phrase in dict.fromkeys(phrases) if phrase not in learned]
        found = self.by_colour.detect(frame, others) if others else []
        if learned:
            found = [*found, *self.learned.detect(frame, learned)]
        return sorted(found, key=lambda d: -d.score)

    def other_shape(self, phrase: str) -> str | None:
        """As the detector by colour says; None for a phrase that is for the learned weights."""
        if not isinstance(self.by_colour, ShapeDetector) or self.is_for_learned(phrase):
            return None
        return self.by_colour.other_shape(phrase)

    def is_for_learned(self, phrase: str) -> bool:
        """Whether the learned weights are asked for a phrase.

        Raises:
            UnknownPhraseError: Neither of the two has a way to look for it.
        """
        try:
            query = parse_phrase(phrase, self._catalogue)
        except UnknownPhraseError as by_colour:
            try:
                self._knows(phrase)
            except UnknownPhraseError as by_learned:
                raise UnknownPhraseError(f"nobody here can look for '{phrase}': {by_colour}; {by_learned}") from None
            return True
        if query.appearance.noun is not None:
            return False
        try:
            self._knows(phrase)
        except UnknownPhraseError:
            return False
        return True

"""Detection by colour and shape with OpenCV: no learned model, no weights, a few milliseconds a phrase.

It knows the nouns and colours of the catalogue and nothing else; it tells things apart by hue, by
round or angular outline and by size. Two things of the same appearance are told apart by their places only.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from perception.catalogue.appearance import Appearance, Colour
from perception.catalogue.catalogue import Catalogue
from perception.catalogue.phrases import Query, parse_phrase
from perception.detection.appearance_scores import equality, outline_score, rise, size_score, stands_on_something
from perception.detection.cut_pieces import CutBlob, join_cut
from perception.frames import RgbdFrame
from perception.geometry.outline import Outline, measure_outline
from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.stacks import Ground, StackPart, box_of, filled_share, split_stack
from perception.interfaces import Detection


@dataclass(frozen=True)
class ColourShapeSettings:
    """Settings of the detector.

    Attributes:
        threshold: Lowest score of a box, 0..1.
        min_area_px: Smallest blob in [px].
        clearance: How far above the support a pixel must be to count as a thing in [m].
        depth_step: Blobs are cut where depth jumps by more than this in [m].
        doubt_px: A blob this long has half the score of a large one: its outline is known to a pixel or two only.
        foot_px: How far a piece may grow into low pixels of its colour, which may be its foot, in [px].
        bridge_px: Gaps up to this wide inside one thing (slats, shading lines) are closed in [px].
    """

    threshold: float = 0.35
    min_area_px: int = 60
    clearance: float = 0.006
    depth_step: float = 0.04
    doubt_px: float = 6.0
    foot_px: int = 5
    bridge_px: int = 5


class ColourShapeDetector:
    """Finds phrases of colour words and known nouns.

    Attributes:
        settings: Thresholds.
        catalogue: Of nouns and colours; the built-in one if None.
    """

    def __init__(self, settings: ColourShapeSettings | None = None, catalogue: Catalogue | None = None) -> None:
        self.settings, self.catalogue = settings or ColourShapeSettings(), catalogue

    @property
    def name(self) -> str:
        """Says that nothing was learned."""
        return "colour-and-shape (OpenCV), not a learned model"

    def detect(self, frame: RgbdFrame, phrases: Sequence[str]) -> list[Detection]:
        """All blobs that look like one of the phrases, best first.

        Raises:
            UnknownPhraseError: A phrase without a known noun and without a colour word.
        """
        queries = [parse_phrase(phrase, self.catalogue) for phrase in phrases]
        frame = PreparedFrame.of(frame)
        # A median over 5 x 5 pixels tells a thing from the noise of the table beside it.
        things = ~frame.valid_depth | (frame.smooth_rises > self.settings.clearance)
        steps = frame.depth_steps(self.settings.depth_step)
        colours = {colour.word: colour for query in queries for colour in query.colours}
        pieces = {word: self._pieces(frame, things, steps, colour) for word, colour in colours.items()}
        found = [d for query in queries for c in query.colours for d in self._find(frame, query, c, pieces[c.word])]
        return sorted(found, key=lambda d: -d.score)

    def other_shape(self, phrase: str) -> str | None:
        """The other shape: "green ball" for a green cube, "green block" for a green apple; None where it is open."""
        query = parse_phrase(phrase, self.catalogue)
        if len(query.colours) != 1:
            return None
        noun = {("angular", "box"): "ball", ("round", "sphere"): "block"}.get(
            (query.appearance.outline, query.appearance.solid)
        )
        return None if noun is None else f"{query.colours[0].word} {noun}"

    def _pieces(
        self, frame: PreparedFrame, things: np.ndarray, steps: np.ndarray, colour: Colour
    ) -> list[tuple[CutBlob, list[StackPart]]]:
        """Blobs of a colour, each with the things that stand on each other in it, if it is not one thing.

        Args:
            frame: The picture.
            things: Pixels that may belong to a thing: above the support, or of unknown height, bool.
            steps: Pixels beside a depth step, bool.
            colour: The colour.
        """
        pixels = colour.matches(frame.hsv)
        # A grey foot cannot be told from a grey table, a red one can.
        reach = pixels if colour.chromatic else pixels & things
        blobs = join_cut(self._blobs(pixels & things, reach, steps), frame.known_depth)
        return [(b, split_stack(b.pixels, Ground(frame)) if b.behind is None else []) for b in blobs]

    def _find(
        self, frame: PreparedFrame, query: Query, colour: Colour, pieces: Sequence[tuple[CutBlob, list[StackPart]]]
    ) -> list[Detection]:
        scored, found = [], []
        for blob, parts in pieces:
            score = self._score(frame, blob, query.appearance, colour)
            # A word that says nothing of sizes means the whole blob.
            if not parts or query.appearance.noun is None:
                scored.append((score, blob))
                continue
            score *= filled_share(parts)
            of_parts = [self._part_score(frame, part, query.appearance, colour) for part in parts]
            if score > max(of_parts):
                scored.append((score, blob))
                continue
            for part_score, part in zip(of_parts, parts, strict=True):
                found.append(Detection(query.phrase, box_of(part.pixels), part_score, part.pixels, rest=part.rest))
        for score, blob in _without_parts(scored):
            found.append(Detection(query.phrase, box_of(blob.pixels), score, blob.pixels, blob.behind))
        return [d for d in found if d.score >= self.settings.threshold]

    def _blobs(self, pixels: np.ndarray, reach: np.ndarray, steps: np.ndarray) -> list[np.ndarray]:
        """Connected pieces of a colour, cut at depth steps, each bool, shape (height, width).

        Args:
            pixels: Of the colour and above the support, bool, shape (height, width).
            reach: Pixels that a piece may grow into by a few pixels, bool, same shape: its foot and its edges.
            steps: Pixels beside a depth step, bool, same shape.
        """
        size = self.settings.bridge_px
        whole = cv2.morphologyEx(pixels.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        reach_open = cv2.morphologyEx(reach.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
        # Cut first, close afterwards: closing must not join two things across the step between them.
        core = np.where(steps, 0, whole).astype(np.uint8)
        core = cv2.morphologyEx(core, cv2.MORPH_CLOSE, np.ones((size, size), np.uint8))
        count, labels, stats, _ = cv2.connectedComponentsWithStats(core, connectivity=8)
        blobs = []
        for i in range(1, count):
            if stats[i, cv2.CC_STAT_AREA] < self.settings.min_area_px:
                continue
            # The pixels beside a step go back to the piece that they touch, and the foot joins it.
            side = 2 * self.settings.foot_px + 1
            grown = cv2.dilate((labels == i).astype(np.uint8), np.ones((side, side), np.uint8)) > 0
            blob = grown & reach_open & ((labels == i) | (labels == 0))
            if blob.sum() >= self.settings.min_area_px:
                blobs.append(blob)
        return blobs

    def _score(self, frame: PreparedFrame, cut: CutBlob, appearance: Appearance, colour: Colour) -> float:
        """How much a blob looks like the noun, 0..1: product of filling, outline, certainty and size."""
        blob = cut.pixels
        outline = measure_outline(cut.whole, frame.known_depth)
        if outline is None:
            return 0.0
        score = (0.4 + 0.6 * outline.fill) * outline_score(outline, appearance)
        score *= outline.long_px / (outline.long_px + self.settings.doubt_px)
        known = blob & np.isfinite(frame.known_depth)
        if known.sum() >= 20:
            distance = float(np.median(frame.known_depth[known]))
            score *= size_score(outline, appearance, outline.long_px * distance / frame.intrinsics.fx)
            score *= self._block_score(frame, blob, outline, appearance)
        return score if self._may_stand(frame, blob, colour) else 0.0

    def _part_score(self, frame: PreparedFrame, part: StackPart, appearance: Appearance, colour: Colour) -> float:
        """The same for one of several things that stand on each other, whose sizes are known."""
        outline = measure_outline(part.covered, frame.known_depth)
        if outline is None or not self._may_stand(frame, part.pixels, colour):
            return 0.0
        score = (0.4 + 0.6 * outline.fill) * outline_score(outline, appearance)
        score *= outline.long_px / (outline.long_px + self.settings.doubt_px)
        low, high = appearance.size
        longest = float(part.sizes.max())
        score *= rise(longest / low, 0.6, 0.9) * rise(-longest / high, -1.7, -1.2)
        return score * (equality(float(part.sizes.max() / part.sizes.min())) if appearance.equal_sides else 1.0)

    def _block_score(self, frame: PreparedFrame, blob: np.ndarray, outline: Outline, appearance: Appearance) -> float:
        """Less than 1 for what has corners and is, in the world, too small or too unequal for its noun.

        A cube's diagonal in the picture may be as long as a small crate's side; and what is wider than it reaches over
        the support is no cube, whatever it stands on.
        """
        if appearance.outline != "angular":
            return 1.0
        sizes = Ground(frame).box_sizes(blob, 0.0)
        longest = max(float(sizes[:2].max()), Ground(frame).seen_height(blob))
        score = rise(longest / (appearance.size[0] * max(0.3, outline.free)), 0.6, 0.9)
        width = float(sizes[:2].min()) - 2.0 * Ground(frame).height_std(blob)
        return score * (equality(width / float(sizes[2])) if appearance.equal_sides else 1.0)

    def _may_stand(self, frame: PreparedFrame, blob: np.ndarray, colour: Colour) -> bool:
        """Whether a blob is no link of an arm and no noise of the table."""
        if colour.chromatic:
            return True
        known = blob & np.isfinite(frame.known_depth)
        # Links of a white, grey or black arm hang in the air; specks of a white table are noise of its height.
        stands = stands_on_something(blob, frame.known_depth)
        return stands and self._rises(frame, known)

    def _rises(self, frame: PreparedFrame, known: np.ndarray) -> bool:
        """Whether the known depths of a blob lie above the support by more than the noise of stereo depth."""
        if known.sum() < 20:
            return False
        noise = frame.depth_std(float(np.median(frame.known_depth[known])))
        return bool(np.median(frame.rises[known]) > self.settings.clearance + 2.0 * noise)


def _without_parts(scored: Sequence[tuple[float, CutBlob]]) -> list[tuple[float, CutBlob]]:
    """Blobs without those that are part of one whose score is as good; the whole is left out if a part's is better."""
    kept = list(scored)
    for whole in [item for item in scored if item[1].behind is not None]:
        parts = [item for item in kept if item is not whole and not (item[1].pixels & ~whole[1].pixels).any()]
        if whole[0] >= max((score for score, _ in parts), default=0.0):
            kept = [item for item in kept if not any(item is part for part in parts)]
        else:
            kept = [item for item in kept if item is not whole]
    return kept

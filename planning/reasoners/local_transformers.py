"""Language models that run in this process: a folder or hub name of a chat model, with or without pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from control.errors import ConfigError, ReasonerError
from perception.detection.devices import choose_device, load_package
from perception.detection.model_files import Role, find_model
from perception.errors import ModelUnavailableError
from planning.language.answers import UnusableAnswerError
from planning.reasoners.chat_texts import chat_messages, shrink, without_thinking
from planning.reasoners.options import ReasonerOptions
from planning.reasoners.reasoner import AnswerUsage, Log

CHAT_MODEL = Role("chat model", "a causal language model with a chat template", (), "Qwen/Qwen3-4B-Instruct-2507")


@dataclass(frozen=True)
class LocalModelOptions:
    """Which model answers in this process, and within which bounds.

    Attributes:
        model: A folder, or a hub name (owner/model).
        device: "auto" (CUDA if there is any), "cpu", "cuda" or "cuda:1".
        offline: Never ask the hub; otherwise a hub model that is not here is fetched.
        max_tokens: Longest answer; a longer one is cut off and asked for again.
        picture_size: Longer edge of the pictures that the model is shown, in pixels.
    """

    model: str
    device: str = ReasonerOptions.device
    offline: bool = ReasonerOptions.offline
    max_tokens: int = ReasonerOptions.max_tokens
    picture_size: int = ReasonerOptions.picture_size

    def __post_init__(self) -> None:
        for name in ("max_tokens", "picture_size"):
            if getattr(self, name) < 1:
                raise ConfigError(f"{name} of a language model must be 1 or more, not {getattr(self, name)}")


class TransformersReasoner:
    """Asks a model that it loads itself; answers are the most probable ones (no sampling), so they repeat.

    Args:
        options: Which one, and bounds.
        log: Gets `model_loaded`.

    Raises:
        ReasonerError: No such model, no chat template, no such device, or a package that is not installed.
    """

    def __init__(self, options: LocalModelOptions, log: Log) -> None:
        self.options = options
        try:
            folder = find_model(options.model, CHAT_MODEL, options.offline)
            self._device = choose_device(options.device)
            self._torch, transformers = load_package("torch"), load_package("transformers")
        except ModelUnavailableError as error:
            raise ReasonerError(f"the language model cannot be used: {error}") from None
        try:
            self._load(folder, transformers)
        # Whatever is in a folder can be broken in as many ways as there are architectures.
        except Exception as error:
            reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
            raise ReasonerError(
                f"'{options.model}' cannot be loaded as {CHAT_MODEL.needed} ({reason}); choose another, such as "
                f"{CHAT_MODEL.example}"
            ) from error
        if not getattr(self._processor, "chat_template", None):
            raise ReasonerError(
                f"'{options.model}' has no chat template, so it does not take questions; choose a model that was "
                f"trained to follow instructions, such as {CHAT_MODEL.example}"
            )
        self._usage = AnswerUsage()
        log("model_loaded", model=options.model, device=self._device, pictures=self.takes_pictures)

    def _load(self, folder: Any, transformers: Any) -> None:
        config = transformers.AutoConfig.from_pretrained(folder, local_files_only=True)
        pictured = transformers.models.auto.modeling_auto.MODEL_FOR_IMAGE_TEXT_TO_TEXT_MAPPING
        written = transformers.models.auto.modeling_auto.MODEL_FOR_CAUSAL_LM_MAPPING
        has_processor = any((folder / n).is_file() for n in ("preprocessor_config.json", "processor_config.json"))
        self.takes_pictures = type(config) in pictured and (has_processor or type(config) not in written)
        reader = transformers.AutoProcessor if self.takes_pictures else transformers.AutoTokenizer
        maker = transformers.AutoModelForImageTextToText if self.takes_pictures else transformers.AutoModelForCausalLM
        self._processor = reader.from_pretrained(folder, local_files_only=True)
        model = maker.from_pretrained(folder, local_files_only=True, dtype="auto")
        self._model = model.to(self._device).eval()
        self._longest = getattr(config.get_text_config(), "max_position_embeddings", None)

    @property
    def name(self) -> str:
        """For reports."""
        return f"{self.options.model} (transformers, {self._device})"

    @property
    def usage(self) -> AnswerUsage:
        """See `planning.reasoners.reasoner.Metered`."""
        return self._usage

    def answer(self, contract: str, prompt: str, fields: Mapping[str, Any], images: Sequence[Any] = ()) -> str:
        """See `planning.reasoners.reasoner.Reasoner`; a model without eyes is not shown the pictures.

        Raises:
            UnusableAnswerError: The answer was cut off.
            ReasonerError: The question is longer than the model takes, or the device has no memory left.
        """
        self._usage = AnswerUsage()
        pictures = images if self.takes_pictures else ()
        parts = [{"type": "image", "image": shrink(p, self.options.picture_size)} for p in pictures]
        messages = chat_messages(contract, prompt, parts)
        if self.takes_pictures:  # their templates want lists of parts throughout
            for message in messages:
                if isinstance(message["content"], str):
                    message["content"] = [{"type": "text", "text": message["content"]}]
        inputs = self._processor.apply_chat_template(
            messages, add_generation_prompt=True, tokenize=True, return_dict=True, return_tensors="pt"
        ).to(self._device)
        asked = int(inputs["input_ids"].shape[1])
        if self._longest is not None and asked >= self._longest:
            raise ReasonerError(
                f"a question of '{contract}' has {asked} tokens, and '{self.options.model}' takes {self._longest} with "
                "its answer; choose a model that takes more"
            )
        room = self.options.max_tokens if self._longest is None else min(self.options.max_tokens, self._longest - asked)
        tokens = self._generate(inputs, room)[asked:]
        self._usage = AnswerUsage(asked, len(tokens))
        text = without_thinking(self._processor.decode(tokens, skip_special_tokens=True))
        if len(tokens) >= room and int(tokens[-1]) not in self._ends():
            raise UnusableAnswerError(f"the answer was cut off after {len(tokens)} tokens; answer more briefly", text)
        return text

    def _generate(self, inputs: Any, room: int) -> Any:
        """Token numbers of question and answer, shape (tokens,)."""
        ends = self._ends()
        try:
            with self._torch.inference_mode():
                return self._model.generate(
                    **inputs, max_new_tokens=room, do_sample=False, pad_token_id=next(iter(ends), 0)
                )[0]
        except self._torch.OutOfMemoryError as error:
            raise ReasonerError(
                f"'{self.options.model}' ran out of memory on {self._device}; choose a smaller model, or --device cpu"
            ) from error

    def _ends(self) -> set[int]:
        """Token numbers that end an answer."""
        ends = self._model.generation_config.eos_token_id
        return set() if ends is None else {ends} if isinstance(ends, int) else set(ends)

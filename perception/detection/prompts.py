"""Prompts of the GroundingDINO family: many phrases in a text, each knowing its own tokens.

A prompt is "[CLS] red cube . crate . [SEP]" in token numbers. The networks cut it at "[CLS]", ".", "?" and "[SEP]":
tokens of one phrase attend to each other only, and count their positions from the phrase's beginning.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from perception.errors import UnknownPhraseError


@dataclass(frozen=True)
class Prompt:
    """One text for the network.

    Attributes:
        tokens: Token numbers, end marks included.
        spans: (first, one after the last) of the tokens of each phrase.
    """

    tokens: tuple[int, ...]
    spans: dict[str, tuple[int, int]]


def make_prompts(tokenizer: Any, phrases: Sequence[str], limit: int, most_phrases: int | None = None) -> list[Prompt]:
    """Join phrases to prompts.

    Args:
        tokenizer: Of the model, BERT's kind.
        phrases: Any number; a phrase that stands twice is asked once.
        limit: Longest prompt in tokens, end marks included.
        most_phrases: Most phrases in a prompt; as many as fit if None.

    Raises:
        UnknownPhraseError: A phrase without any word, longer than a prompt, or without any token of the vocabulary.
    """
    stop = _token(tokenizer, ".")
    prompts: list[Prompt] = []
    tokens, spans = [tokenizer.cls_token_id], {}
    for phrase in dict.fromkeys(phrases):
        own = _phrase_tokens(tokenizer, phrase, limit)
        full = len(tokens) + len(own) + 2 > limit or (most_phrases is not None and len(spans) >= most_phrases)
        if spans and full:
            prompts.append(Prompt((*tokens, tokenizer.sep_token_id), spans))
            tokens, spans = [tokenizer.cls_token_id], {}
        spans[phrase] = (len(tokens), len(tokens) + len(own))
        tokens += [*own, stop]
    if spans:
        prompts.append(Prompt((*tokens, tokenizer.sep_token_id), spans))
    return prompts


def side_by_side(prompts: Sequence[Prompt], padding: int) -> tuple[np.ndarray, np.ndarray]:
    """Prompts as one array, the shorter ones filled up.

    Args:
        prompts: At least one.
        padding: Token number to fill with.

    Returns:
        Token numbers and whether each is text (1) or filling (0), both int64, shape (prompts, longest).
    """
    longest = max(len(p.tokens) for p in prompts)
    tokens = np.full((len(prompts), longest), padding, np.int64)
    text = np.zeros_like(tokens)
    for row, prompt in enumerate(prompts):
        tokens[row, : len(prompt.tokens)] = prompt.tokens
        text[row, : len(prompt.tokens)] = 1
    return tokens, text


def separates(tokenizer: Any, separators: Sequence[int]) -> bool:
    """Whether a network that cuts texts at these token numbers would cut this tokenizer's prompts between phrases."""
    return {tokenizer.cls_token_id, tokenizer.sep_token_id, _token(tokenizer, ".")} <= set(separators)


def _phrase_tokens(tokenizer: Any, phrase: str, limit: int) -> list[int]:
    # Marks that cut a prompt, or that the tokenizer takes for one of its own, are no part of a name.
    words = " ".join("".join(" " if c in ".?[]" else c for c in phrase).lower().split())
    if not words:
        raise UnknownPhraseError(
            f"the phrase '{phrase}' names nothing to look for; give at least one word, for instance 'red cube'"
        )
    own = tokenizer(words, add_special_tokens=False)["input_ids"]
    if len(own) + 3 > limit:
        raise UnknownPhraseError(
            f"the phrase '{phrase[:40]}...' has {len(own)} tokens, but a prompt holds {limit - 3}; shorten it"
        )
    if all(token == tokenizer.unk_token_id for token in own):
        raise UnknownPhraseError(
            f"no part of the phrase '{phrase}' is in the detector's vocabulary; say it in plain English words"
        )
    return own


def _token(tokenizer: Any, mark: str) -> int:
    return tokenizer.convert_tokens_to_ids(mark)

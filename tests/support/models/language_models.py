"""Tiny chat models with random weights in a folder, of the same classes as the published ones, for the tests."""

from pathlib import Path
from typing import cast

from perception.detection.devices import load_package

TEMPLATE = (
    "{% for m in messages %}<s>{{ m['role'] }}: "
    "{% if m['content'] is string %}{{ m['content'] }}{% else %}"
    "{% for part in m['content'] %}{{ '<image>' if part['type'] == 'image' else part['text'] }}{% endfor %}{% endif %}"
    "</s>\n{% endfor %}{% if add_generation_prompt %}<s>assistant: {% endif %}"
)
SPECIAL = ("<pad>", "<s>", "</s>", "<unk>", "<image>")
PATCHES = 4  # tokens that a picture is to the tiny vision model
LONGEST = 4096  # tokens of question and answer; a token is a byte


def tiny_tokenizer(template: str | None = TEMPLATE):
    """One token per byte."""
    from tokenizers import Tokenizer, decoders, models, pre_tokenizers
    from transformers import PreTrainedTokenizerFast

    letters = sorted(pre_tokenizers.ByteLevel.alphabet())
    vocabulary = {token: k for k, token in enumerate((*SPECIAL, *letters))}
    tokenizer = Tokenizer(models.BPE(vocab=vocabulary, merges=[], unk_token="<unk>"))
    tokenizer.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    tokenizer.decoder = decoders.ByteLevel()
    fast = PreTrainedTokenizerFast(
        tokenizer_object=tokenizer,
        pad_token="<pad>",
        bos_token="<s>",
        eos_token="</s>",
        unk_token="<unk>",
        additional_special_tokens=["<image>"],
        model_max_length=LONGEST,
    )
    fast.chat_template = template
    return fast


def save_tiny_chat_model(folder: Path, template: str | None = TEMPLATE) -> None:
    """A Llama of some ten thousand weights that answers nonsense."""
    torch = load_package("torch")
    from transformers import LlamaForCausalLM

    torch.manual_seed(0)
    tokenizer = tiny_tokenizer(template)
    tokenizer.save_pretrained(folder)
    LlamaForCausalLM(_llama_config(len(tokenizer))).save_pretrained(folder)


def save_tiny_vision_model(folder: Path) -> None:
    """A Llava of as many weights, to which a picture of any size is 2 x 2 patches."""
    torch = load_package("torch")
    from transformers import (
        CLIPImageProcessor,
        CLIPVisionConfig,
        LlavaConfig,
        LlavaForConditionalGeneration,
        LlavaProcessor,
    )

    torch.manual_seed(0)
    tokenizer = tiny_tokenizer()
    sees = CLIPVisionConfig(
        hidden_size=16,
        intermediate_size=32,
        num_hidden_layers=1,
        num_attention_heads=2,
        image_size=28,
        patch_size=14,
        projection_dim=16,
    )
    image_token = cast(int, tokenizer.convert_tokens_to_ids("<image>"))
    config = LlavaConfig(
        vision_config=sees,
        text_config=_llama_config(len(tokenizer)),
        image_token_index=image_token,
        vision_feature_layer=-1,
        image_seq_length=PATCHES,
    )
    LlavaForConditionalGeneration(config).save_pretrained(folder)
    pictures = CLIPImageProcessor(size={"shortest_edge": 28}, crop_size={"height": 28, "width": 28})
    LlavaProcessor(
        pictures,
        tokenizer,
        patch_size=14,
        vision_feature_select_strategy="default",
        num_additional_image_tokens=1,
        chat_template=TEMPLATE,
    ).save_pretrained(folder)


def _llama_config(vocabulary: int):
    from transformers import LlamaConfig

    return LlamaConfig(
        vocab_size=vocabulary,
        hidden_size=16,
        intermediate_size=32,
        num_hidden_layers=1,
        num_attention_heads=2,
        num_key_value_heads=1,
        max_position_embeddings=LONGEST,
        pad_token_id=0,
        bos_token_id=1,
        eos_token_id=2,
    )

"""Tiny models with random weights in a folder, of the same classes as the published ones, for the tests."""

import string
from pathlib import Path

from perception.hf_models import load_package

# transformers' GroundingDINO cuts prompts at these fixed ids: begin, end, full stop, question mark.
FIXED_IDS = {"[PAD]": 0, "[UNK]": 100, "[CLS]": 101, "[SEP]": 102, "[MASK]": 103, ".": 1012, "?": 1029}
WORDS = ("red", "yellow", "cube", "crate", "apple", "bowl", *string.ascii_lowercase)


def tiny_vocabulary() -> dict[str, int]:
    """Words and letters around the fixed ids; "banana" is not in it and falls apart into letters."""
    vocabulary = dict(FIXED_IDS)
    free = iter(i for i in range(1030) if i not in FIXED_IDS.values())
    for word in (*WORDS, *(f"##{letter}" for letter in string.ascii_lowercase)):
        vocabulary[word] = next(free)
    for i in free:
        vocabulary[f"[unused{i}]"] = i
    return vocabulary


def save_tiny_detector(folder: Path) -> None:
    """A GroundingDINO of a few hundred thousand weights."""
    torch = load_package("torch")
    from transformers import (
        BertConfig,
        BertTokenizer,
        ConvNextConfig,
        GroundingDinoConfig,
        GroundingDinoForObjectDetection,
        GroundingDinoImageProcessor,
        GroundingDinoProcessor,
    )

    torch.manual_seed(0)
    vocabulary = tiny_vocabulary()
    config = GroundingDinoConfig(
        backbone_config=ConvNextConfig(hidden_sizes=[8, 16, 32, 64], depths=[1, 1, 1, 1], out_indices=[2, 3, 4]),  # type: ignore[call-arg]
        text_config=BertConfig(
            vocab_size=len(vocabulary),
            hidden_size=32,
            num_hidden_layers=1,
            num_attention_heads=2,
            intermediate_size=32,
            max_position_embeddings=32,
        ),
        d_model=32,
        encoder_layers=1,
        decoder_layers=2,  # with one there is nothing to tie its heads to, and the class refuses
        encoder_ffn_dim=32,
        decoder_ffn_dim=32,
        encoder_attention_heads=2,
        decoder_attention_heads=2,
        num_queries=12,
        num_feature_levels=3,
        max_text_len=32,
    )
    GroundingDinoForObjectDetection(config).save_pretrained(folder)
    images = GroundingDinoImageProcessor(size={"shortest_edge": 96, "longest_edge": 160})
    GroundingDinoProcessor(images, BertTokenizer(vocab=vocabulary, do_lower_case=True)).save_pretrained(folder)


def save_tiny_segmenter(folder: Path) -> None:
    """A SAM of a few hundred thousand weights."""
    torch = load_package("torch")
    from transformers import (
        SamConfig,
        SamImageProcessor,
        SamMaskDecoderConfig,
        SamModel,
        SamProcessor,
        SamPromptEncoderConfig,
        SamVisionConfig,
    )

    torch.manual_seed(0)
    config = SamConfig(
        vision_config=SamVisionConfig(
            hidden_size=32,
            output_channels=32,
            num_hidden_layers=1,
            num_attention_heads=2,
            image_size=128,
            patch_size=16,
            window_size=4,
            global_attn_indexes=[0],
            num_pos_feats=16,
            mlp_dim=32,
        ),
        prompt_encoder_config=SamPromptEncoderConfig(
            hidden_size=32, image_size=128, patch_size=16, mask_input_channels=4
        ),
        mask_decoder_config=SamMaskDecoderConfig(
            hidden_size=32, mlp_dim=32, num_hidden_layers=1, num_attention_heads=2, iou_head_hidden_dim=32
        ),
    )
    SamModel(config).save_pretrained(folder)
    images = SamImageProcessor(
        size={"longest_edge": 128},
        pad_size={"height": 128, "width": 128},
        mask_size={"longest_edge": 32},
        mask_pad_size={"height": 32, "width": 32},
    )
    SamProcessor(images).save_pretrained(folder)

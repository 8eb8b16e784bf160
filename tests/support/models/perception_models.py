"""Tiny models with random weights in a folder, of the same classes as the published ones, for the tests."""

import string
from pathlib import Path
from typing import Any

from perception.detection.devices import load_package

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


def save_tiny_detector(folder: Path, mm: bool = False) -> None:
    """A GroundingDINO, or an MM-GroundingDINO, of a few hundred thousand weights."""
    torch = load_package("torch")
    from transformers import (
        BertConfig,
        BertTokenizer,
        ConvNextConfig,
        GroundingDinoConfig,
        GroundingDinoForObjectDetection,
        GroundingDinoImageProcessor,
        GroundingDinoProcessor,
        MMGroundingDinoConfig,
        MMGroundingDinoForObjectDetection,
    )

    torch.manual_seed(0)
    vocabulary = tiny_vocabulary()
    make_config: Any = MMGroundingDinoConfig if mm else GroundingDinoConfig
    make_network: Any = MMGroundingDinoForObjectDetection if mm else GroundingDinoForObjectDetection
    config = make_config(
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
    network = make_network(config)
    if mm:
        # Its class head has a bias, zero when new; published and trained ones are far from it.
        with torch.no_grad():
            for name, weight in network.named_parameters():
                if "class_embed" in name and name.endswith("bias") and weight.numel() == 1:
                    weight.fill_(-1.5)
    network.save_pretrained(folder)
    images = GroundingDinoImageProcessor(size={"shortest_edge": 96, "longest_edge": 160})
    GroundingDinoProcessor(images, BertTokenizer(vocab=vocabulary, do_lower_case=True)).save_pretrained(folder)


def save_tiny_segmenter(folder: Path) -> None:
    """A SAM of a few hundred thousand weights, for pictures or crops of 128 px."""
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


def save_tiny_sam2(folder: Path) -> None:
    """A SAM 2 of a few hundred thousand weights; as published, without a processor that works without torchvision."""
    torch = load_package("torch")
    from transformers import (
        Sam2Config,
        Sam2HieraDetConfig,
        Sam2MaskDecoderConfig,
        Sam2Model,
        Sam2PromptEncoderConfig,
        Sam2VisionConfig,
    )

    torch.manual_seed(0)
    backbone = Sam2HieraDetConfig(
        hidden_size=8,
        num_attention_heads=1,
        image_size=[128, 128],
        blocks_per_stage=[1, 1, 2, 1],
        embed_dim_per_stage=[8, 16, 32, 64],
        num_attention_heads_per_stage=[1, 2, 4, 8],
        window_size_per_stage=[4, 4, 4, 4],
        global_attention_blocks=[3],
    )
    config = Sam2Config(
        vision_config=Sam2VisionConfig(
            backbone_config=backbone,  # type: ignore[arg-type]
            backbone_channel_list=[64, 32, 16, 8],
            backbone_feature_sizes=[[32, 32], [16, 16], [8, 8]],
            fpn_hidden_size=32,
            num_feature_levels=3,
        ),
        prompt_encoder_config=Sam2PromptEncoderConfig(hidden_size=32, image_size=128, patch_size=16),
        mask_decoder_config=Sam2MaskDecoderConfig(
            hidden_size=32, mlp_dim=32, num_hidden_layers=1, num_attention_heads=2, iou_head_hidden_dim=32
        ),
    )
    Sam2Model(config).save_pretrained(folder)

"""Small networks of the published architectures, untrained: MM-GroundingDINO for boxes, SAM for masks."""

from typing import Any

from perception.detection.devices import load_package

MOST_TEXT = 64  # tokens
SAM_SIDE = 128  # [px]


def new_detector(vocabulary: int, width: int = 32, depth: int = 64, queries: int = 48) -> Any:
    """An MM-GroundingDINO with a ConvNeXt backbone and no feature enhancer.

    Without the enhancer (encoder layers in which pictures and text look at each other) pictures and text meet in the
    proposals and in the decoder only. It costs half as much to train, which on a CPU is worth more than the layers.

    Args:
        vocabulary: Number of token ids.
        width: Channels of the backbone's first stage.
        depth: Width of encoder and decoder, a multiple of 32.
        queries: Boxes proposed a picture.
    """
    torch, transformers = load_package("torch"), load_package("transformers")
    backbone = transformers.ConvNextConfig(
        hidden_sizes=[width, 2 * width, 4 * width, 8 * width],
        depths=[1, 2, 3, 1],
        drop_path_rate=0.0,
        out_indices=[2, 3, 4],
        layer_scale_init_value=1.0,  # the usual 1e-6 makes every block an identity, which takes ages to leave
    )
    text = transformers.BertConfig(
        vocab_size=vocabulary,
        hidden_size=64,
        num_hidden_layers=1,
        num_attention_heads=4,
        intermediate_size=128,
        max_position_embeddings=MOST_TEXT,
        hidden_dropout_prob=0.0,
        attention_probs_dropout_prob=0.0,
    )
    config = transformers.MMGroundingDinoConfig(
        backbone_config=backbone,
        text_config=text,
        d_model=depth,
        encoder_layers=0,
        decoder_layers=2,
        encoder_ffn_dim=4 * depth,
        decoder_ffn_dim=4 * depth,
        encoder_attention_heads=4,
        decoder_attention_heads=4,
        num_queries=queries,
        num_feature_levels=3,
        max_text_len=MOST_TEXT,
        dropout=0.0,
        fusion_droppath=0.0,
        auxiliary_loss=True,
    )
    model = transformers.MMGroundingDinoForObjectDetection(config)
    with torch.no_grad():  # begin with "nothing is anything": most boxes show nothing
        for name, weight in model.named_parameters():
            if "class_embed" in name and name.endswith(".bias") and weight.numel() == 1:
                weight.fill_(-4.0)
    return model


def detector_processor(tokenizer: Any, short_side: int, long_side: int) -> Any:
    """Resizing, normalisation and tokens for the detector."""
    transformers = load_package("transformers")
    pictures = transformers.GroundingDinoImageProcessor(size={"shortest_edge": short_side, "longest_edge": long_side})
    return transformers.GroundingDinoProcessor(pictures, tokenizer)


def new_segmenter(width: int = 96, layers: int = 4) -> Any:
    """A SAM that looks at a crop of `SAM_SIDE` pixels around one box."""
    transformers = load_package("transformers")
    vision = transformers.SamVisionConfig(
        hidden_size=width,
        output_channels=64,
        num_hidden_layers=layers,
        num_attention_heads=4,
        image_size=SAM_SIDE,
        patch_size=8,
        window_size=8,
        global_attn_indexes=[1, layers - 1],
        num_pos_feats=32,
        mlp_dim=3 * width,
    )
    prompt = transformers.SamPromptEncoderConfig(
        hidden_size=64, image_size=SAM_SIDE, patch_size=8, mask_input_channels=8, image_embedding_size=SAM_SIDE // 8
    )
    decoder = transformers.SamMaskDecoderConfig(
        hidden_size=64,
        mlp_dim=128,
        num_hidden_layers=2,
        num_attention_heads=4,
        attention_downsample_rate=2,
        iou_head_hidden_dim=64,
    )
    config = transformers.SamConfig(vision_config=vision, prompt_encoder_config=prompt, mask_decoder_config=decoder)
    return transformers.SamModel(config)

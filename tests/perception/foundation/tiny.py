"""Tiny random networks of the real architectures, saved as the hub has them, for the real loading code."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnx.numpy_helper
import pytest

NAMES = {
    "grounding_dino": "grounding-dino-tiny",
    "mm_grounding_dino": "mm-grounding-dino-tiny",
    "owlv2": "owlv2-base",
    "owlvit": "owlvit-base-patch32",
    "sam": "sam-vit-base",
    "sam2": "sam2.1-hiera-tiny",
    "mobile_sam": "mobile-sam",
    "mask2former": "mask2former-swin-tiny",
    "oneformer": "oneformer-swin-large",
    "sam3": "sam3",
    "clip": "clip-vit-base",
    "siglip": "siglip-base",
}
"""Back end -> the model whose place its tiny network takes."""
SIZES = {"hidden_size": 32, "intermediate_size": 32, "num_hidden_layers": 2, "num_attention_heads": 2}
"""Of the encoders of pictures and of texts."""


def made(kind: str, root: Path, name: str | None = None) -> Path:
    """The folder of a back end's tiny network, made at the first call; `name`: of the model whose place it takes."""
    folder = root / (name or NAMES[kind])
    if not folder.exists():
        folder.mkdir()
        globals()[kind](folder)
    return folder


def torch_or_skip() -> tuple[Any, Any]:
    """(torch, transformers); the test is skipped, and says so, where they are not installed."""
    reason = "the extra `foundation` (torch, transformers) is not installed"
    torch = pytest.importorskip("torch", reason=reason)
    return torch, pytest.importorskip("transformers", reason=reason)


WORDS = "a the red blue wooden cup mug of coffee chair table lamp floor wall door box crate book ##s chand ##elier , -"


def bert_tokenizer(folder: Path) -> Any:
    """A BERT tokenizer over a few words."""
    _, transformers = torch_or_skip()
    vocabulary = ["[PAD]", *(f"[unused{i}]" for i in range(99)), "[UNK]", "[CLS]", "[SEP]", "[MASK]"]
    words = [*vocabulary, *(f"[unused{i}]" for i in range(99, 994)), *"!", *"\"#$%&'()*+,-./0123456789:;<=>?"]
    words = list(dict.fromkeys([*words, *WORDS.split()]))
    (folder / "vocab.txt").write_text("\n".join(words) + "\n")
    return transformers.BertTokenizer.from_pretrained(folder)


def save(folder: Path, *parts: Any) -> None:
    """Save a network and its processors."""
    for part in parts:
        part.save_pretrained(folder)


def tiny_swin() -> dict[str, Any]:
    return {
        "image_size": 64, "embed_dim": 16, "depths": [1, 1, 1, 1], "num_heads": [1, 1, 2, 2],
        "window_size": 4,
    }  # fmt: skip


def grounding_dino(folder: Path, kind: str = "GroundingDino") -> None:
    """A whole Grounding DINO of 16 queries and 32 channels."""
    torch, transformers = torch_or_skip()
    tokenizer = bert_tokenizer(folder)
    config = getattr(transformers, f"{kind}Config")(
        backbone_config=transformers.SwinConfig(**tiny_swin(), out_features=["stage2", "stage3", "stage4"]),
        text_config=transformers.BertConfig(
            vocab_size=len(tokenizer), hidden_size=32, num_hidden_layers=2, num_attention_heads=2, intermediate_size=64
        ),
        d_model=32, encoder_layers=2, decoder_layers=2, encoder_ffn_dim=64, decoder_ffn_dim=64,
        encoder_attention_heads=4, decoder_attention_heads=4, num_queries=16,
    )  # fmt: skip
    torch.manual_seed(0)
    model = getattr(transformers, f"{kind}ForObjectDetection")(config)
    spread(model)
    calm(model, "bbox_embed")
    image = transformers.GroundingDinoImageProcessorPil(size={"shortest_edge": 96, "longest_edge": 160})
    save(folder, model, tokenizer, image)


def mm_grounding_dino(folder: Path) -> None:
    """MM Grounding DINO of the same size."""
    grounding_dino(folder, "MMGroundingDino")


def sam(folder: Path) -> None:
    """SAM of one layer on images of 64 pixels a side."""
    torch, t = torch_or_skip()
    torch.manual_seed(0)
    config = t.SamConfig(
        vision_config=t.SamVisionConfig(
            hidden_size=32, output_channels=16, num_hidden_layers=2, num_attention_heads=2, image_size=64, patch_size=8,
            window_size=4, global_attn_indexes=[1], mlp_dim=32, num_pos_feats=8,
        ),
        prompt_encoder_config=t.SamPromptEncoderConfig(
            hidden_size=16, image_size=64, patch_size=8, image_embedding_size=8
        ),
        mask_decoder_config=t.SamMaskDecoderConfig(
            hidden_size=16, mlp_dim=32, num_hidden_layers=2, num_attention_heads=2, iou_head_hidden_dim=16,
        ),
    )  # fmt: skip
    processor = t.SamImageProcessorPil(size={"longest_edge": 64}, pad_size={"height": 64, "width": 64})
    model = t.SamModel(config)
    spread(model)
    save(folder, model, processor)


def sam2(folder: Path) -> None:
    """SAM 2 of few layers on images of 128 pixels a side."""
    torch, t = torch_or_skip()
    torch.manual_seed(0)
    config = t.Sam2Config(
        vision_config=t.Sam2VisionConfig(
            backbone_config=t.Sam2HieraDetConfig(
                hidden_size=8, num_attention_heads=1, image_size=[128, 128], blocks_per_stage=[1, 1, 2, 1],
                embed_dim_per_stage=[8, 16, 32, 64], num_attention_heads_per_stage=[1, 1, 2, 2],
                window_size_per_stage=[8, 4, 4, 4], global_attention_blocks=[3],
                window_positional_embedding_background_size=[4, 4],
            ),
            backbone_channel_list=[64, 32, 16, 8], backbone_feature_sizes=[[32, 32], [16, 16], [8, 8]],
            fpn_hidden_size=32, fpn_top_down_levels=[2, 3],
        ),
        prompt_encoder_config=t.Sam2PromptEncoderConfig(hidden_size=32, image_size=128, patch_size=16),
        mask_decoder_config=t.Sam2MaskDecoderConfig(
            hidden_size=32, mlp_dim=32, num_hidden_layers=2, num_attention_heads=2, iou_head_hidden_dim=16
        ),
    )  # fmt: skip
    model = t.Sam2Model(config)
    spread(model)
    save(folder, model)


def clip_tokenizer(folder: Path) -> Any:
    """A CLIP tokenizer over bytes, without merges."""
    import json

    _, t = torch_or_skip()
    letters = [chr(c) for c in range(ord("!"), ord("~") + 1)]
    # As in the published one the special tokens are the last: OWLv2 takes a first token of 0 for padding.
    words = [*letters, *(letter + "</w>" for letter in letters), "<|startoftext|>", "<|endoftext|>"]
    (folder / "vocab.json").write_text(json.dumps({word: i for i, word in enumerate(words)}))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    return t.CLIPTokenizer.from_pretrained(folder)


def special(tokenizer: Any) -> dict[str, int]:
    """What a CLIP-like text configuration has to know of its tokenizer."""
    ends = {"bos_token_id": tokenizer.bos_token_id, "eos_token_id": tokenizer.eos_token_id}
    return {**ends, "pad_token_id": tokenizer.pad_token_id, "vocab_size": len(tokenizer)}


def owlv2(folder: Path, kind: str = "Owlv2") -> None:
    """OWLv2 of two layers on images of 64 pixels a side."""
    torch, t = torch_or_skip()
    tokenizer = clip_tokenizer(folder)
    torch.manual_seed(0)
    config = getattr(t, f"{kind}Config")(
        text_config={**SIZES, **special(tokenizer), "max_position_embeddings": 32},
        vision_config={**SIZES, "image_size": 64, "patch_size": 16},
        projection_dim=32,
    )
    processor = getattr(t, f"{kind}ImageProcessorPil")(size={"height": 64, "width": 64})
    model = getattr(t, f"{kind}ForObjectDetection")(config)
    calm(model, "box_head")
    save(folder, model, tokenizer, processor)


def owlvit(folder: Path) -> None:
    """OWL-ViT of the same size."""
    owlv2(folder, "OwlViT")


LABELS = {0: "chair", 1: "wall-other-merged", 2: "cup", 3: "ceiling-merged"}


def mask2former(folder: Path) -> None:
    """Mask2Former of one decoder layer and 12 queries over four classes."""
    torch, t = torch_or_skip()
    torch.manual_seed(0)
    config = t.Mask2FormerConfig(
        backbone_config=t.SwinConfig(**tiny_swin(), out_features=["stage1", "stage2", "stage3", "stage4"]),
        feature_size=32, mask_feature_size=32, hidden_dim=32, encoder_feedforward_dim=32, encoder_layers=1,
        decoder_layers=2, num_attention_heads=2, dim_feedforward=32, num_queries=12, id2label=LABELS,
    )  # fmt: skip
    model = t.Mask2FormerForUniversalSegmentation(config)
    spread(model)
    processor = t.Mask2FormerImageProcessorPil(size={"shortest_edge": 64, "longest_edge": 96})
    save(folder, model, processor)


def spread(model: Any, std: float = 0.25, seed: int = 0) -> None:
    """Draw the weights wider than the library does, so that outputs differ by place and prompt."""
    torch, _ = torch_or_skip()
    torch.manual_seed(seed)
    for parameter in model.parameters():
        if parameter.ndim > 1:
            torch.nn.init.normal_(parameter, std=std)


def calm(model: Any, name: str) -> None:
    """Make the offsets of a box head small, so that boxes lie about where the image is looked at."""
    for key, parameter in model.named_parameters():
        if name in key:
            parameter.data *= 0.3


def oneformer(folder: Path) -> None:
    """OneFormer of one decoder layer and 12 queries over four classes."""
    torch, t = torch_or_skip()
    tokenizer = clip_tokenizer(folder)
    torch.manual_seed(0)
    config = t.OneFormerConfig(
        backbone_config=t.SwinConfig(**tiny_swin(), out_features=["stage1", "stage2", "stage3", "stage4"]),
        num_queries=12, is_training=False, hidden_dim=32, mask_dim=32, conv_dim=32, encoder_feedforward_dim=32,
        encoder_layers=1, decoder_layers=2, num_attention_heads=2, dim_feedforward=32, query_dec_layers=1,
        task_seq_len=24, max_seq_len=24, text_encoder_vocab_size=len(tokenizer), text_encoder_width=32,
        text_encoder_context_length=24, text_encoder_num_layers=1, id2label=LABELS,
    )  # fmt: skip
    model = t.OneFormerForUniversalSegmentation(config)
    spread(model, 0.2, seed=3)  # some of its queries' masks overlap little enough to stay
    processor = t.OneFormerImageProcessorPil(size={"shortest_edge": 64, "longest_edge": 96}, class_info_file=None)
    save(folder, model, tokenizer, processor)


def sam3(folder: Path) -> None:
    """SAM 3 of few layers on images of 112 pixels a side."""
    torch, t = torch_or_skip()
    tokenizer = clip_tokenizer(folder)
    torch.manual_seed(0)
    sizes = {"hidden_size": 32, "intermediate_size": 32, "num_attention_heads": 2}
    config = t.Sam3Config(
        vision_config=t.Sam3VisionConfig(
            backbone_config=t.Sam3ViTConfig(
                **sizes, num_hidden_layers=2, image_size=112, patch_size=14, window_size=4, global_attn_indexes=[1],
                pretrain_image_size=56,
            ),
            fpn_hidden_size=32, backbone_feature_sizes=[[32, 32], [16, 16], [8, 8]],
        ),
        text_config={**SIZES, **special(tokenizer), "projection_dim": 16,
                     "max_position_embeddings": 32, "hidden_act": "gelu"},
        geometry_encoder_config=t.Sam3GeometryEncoderConfig(**sizes, num_layers=1),
        detr_encoder_config=t.Sam3DETREncoderConfig(**sizes, num_layers=1),
        detr_decoder_config=t.Sam3DETRDecoderConfig(**sizes, num_layers=1, num_queries=8),
        mask_decoder_config=t.Sam3MaskDecoderConfig(hidden_size=32, num_attention_heads=2),
    )  # fmt: skip
    model = t.Sam3Model(config)
    spread(model)
    save(folder, model, tokenizer)


def clip(folder: Path) -> None:
    """CLIP of two layers on images of 32 pixels a side."""
    torch, t = torch_or_skip()
    tokenizer = clip_tokenizer(folder)
    torch.manual_seed(0)
    config = t.CLIPConfig(
        text_config={**SIZES, **special(tokenizer), "max_position_embeddings": 32},
        vision_config={**SIZES, "image_size": 32, "patch_size": 8},
        projection_dim=16,
    )
    model = t.CLIPModel(config)
    spread(model)
    processor = t.CLIPImageProcessorPil(size={"shortest_edge": 32}, crop_size={"height": 32, "width": 32})
    save(folder, model, tokenizer, processor)


def siglip(folder: Path) -> None:
    """SigLIP of two layers on images of 32 pixels a side."""
    torch, t = torch_or_skip()
    torch.manual_seed(0)
    config = t.SiglipConfig(
        text_config={**SIZES, "vocab_size": 64, "bos_token_id": 1, "eos_token_id": 2, "pad_token_id": 0},
        vision_config={**SIZES, "image_size": 32, "patch_size": 8},
    )
    model = t.SiglipModel(config)
    spread(model)
    save(folder, model, t.SiglipImageProcessorPil(size={"height": 32, "width": 32}))


def mobile_sam(folder: Path) -> None:
    """Graphs with MobileSAM's names: a mean of the image; a mask that is its box, inside out for a bright image."""
    write_encoder(folder / "mobile_sam_image_encoder.onnx", normalised=False)
    write_decoder(folder / "sam_mask_decoder_single.onnx")


def write_encoder(path: Path, *, normalised: bool) -> None:
    """An encoder of the raw image (H, W, 3), or of the normalised square (1, 3, 1024, 1024)."""
    shape = [1, 3, 1024, 1024] if normalised else ["height", "width", 3]
    axes = list(range(len(shape)))
    nodes = [
        onnx.helper.make_node("ReduceMean", ["input_image"], ["mean"], axes=axes, keepdims=0),
        onnx.helper.make_node("Reshape", ["mean", "shape"], ["image_embeddings"]),
    ]
    constants = [onnx.numpy_helper.from_array(np.array([1, 1, 1, 1]), "shape")]
    write_graph(path, nodes, constants, {"input_image": shape}, {"image_embeddings": [1, 1, 1, 1]})


def write_decoder(path: Path) -> None:
    """A decoder: least distance to the box's sides, times -1 where the embedding is over 128."""
    node, grid = onnx.helper.make_node, (np.arange(256, dtype=np.float32) + 0.5) * 4
    corners = [(f"{name}{i}", [[0, i, j]]) for i in (0, 1) for j, name in enumerate("xy")]
    constants = [onnx.numpy_helper.from_array(np.array(at), f"at_{name}") for name, at in corners]
    constants += [
        onnx.numpy_helper.from_array(grid.reshape(1, 1, 1, 256), "columns"),
        onnx.numpy_helper.from_array(grid.reshape(1, 1, 256, 1), "rows"),
        onnx.numpy_helper.from_array(np.array(128, dtype=np.float32), "bright"),
        *(onnx.numpy_helper.from_array(np.array(v, dtype=np.float32), f"v{v}") for v in (1, 2)),
    ]
    nodes = [node("GatherND", ["point_coords", f"at_{name}"], [name]) for name, _ in corners]
    nodes += [
        node("Sub", ["columns", "x0"], ["left"]),
        node("Sub", ["x1", "columns"], ["right"]),
        node("Sub", ["rows", "y0"], ["upper"]),
        node("Sub", ["y1", "rows"], ["lower"]),
        node("Min", ["left", "right", "upper", "lower"], ["inside"]),
        node("Greater", ["image_embeddings", "bright"], ["is_bright"]),
        node("Cast", ["is_bright"], ["one"], to=onnx.TensorProto.FLOAT),
        node("Mul", ["one", "v2"], ["two"]),
        node("Sub", ["v1", "two"], ["sign"]),
        node("Mul", ["inside", "sign"], ["low_res_masks"]),
    ]
    given = {
        "image_embeddings": [1, 1, 1, 1], "point_coords": [1, 2, 2], "point_labels": [1, 2],
        "mask_input": [1, 1, 256, 256], "has_mask_input": [1], "orig_im_size": [2],
    }  # fmt: skip
    write_graph(path, nodes, constants, given, {"low_res_masks": [1, 1, 256, 256]})


def write_graph(path: Path, nodes: Any, constants: Any, given: dict[str, Any], made: dict[str, Any]) -> None:
    """An ONNX file; `given` and `made`: shapes of inputs and outputs by name, all single precision."""
    ends = [
        [onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, shape) for name, shape in some.items()]
        for some in (given, made)
    ]
    graph = onnx.helper.make_graph(nodes, "tiny", *ends, initializer=constants)
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, path)


def letters(folder: Path) -> None:
    """A tokenizer of twenty letters beside a tiny network whose own tokenizer cannot be made small."""
    from tokenizers import Tokenizer, models, pre_tokenizers

    _, t = torch_or_skip()
    words = ["[PAD]", "[BOS]", "[EOS]", "[UNK]", *"abcdefghijklmnopqrstuvwxyz"]
    tokenizer = Tokenizer(models.WordLevel({word: i for i, word in enumerate(words)}, unk_token="[UNK]"))
    tokenizer.pre_tokenizer = pre_tokenizers.Split("", "isolated")
    t.PreTrainedTokenizerFast(tokenizer_object=tokenizer, pad_token="[PAD]", unk_token="[UNK]").save_pretrained(folder)

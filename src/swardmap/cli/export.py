"""`swardmap export`: a checkpoint to an .onnx file that says all about itself."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from swardmap.cli.options import Json
from swardmap.errors import ModelError, require


def export(
    checkpoint: Annotated[Path, typer.Argument(help="best.pt or last.pt of `swardmap train`.")],
    data: Annotated[Path, typer.Option("--data", help="Folder that the recipe's data folders are in.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The .onnx file.")],
    int8: Annotated[bool, typer.Option(help="Quantise; --no-int8 keeps float32, for GPUs.")] = True,
    images: Annotated[int, typer.Option(min=1, help="Training images that calibrate INT8.")] = 64,
    size: Annotated[
        tuple[int, int] | None, typer.Option(help="Width and height of the input, if not the recipe's.")
    ] = None,
    grass_bias: Annotated[
        float, typer.Option(help="Added to grass's logit: less grass missed, more obstacles called grass.")
    ] = 0.0,
    blend: Annotated[
        list[Path] | None,
        typer.Option(help="Checkpoint to mix in, such as the start.pt of a fine-tuning. Repeatable."),
    ] = None,
    blend_share: Annotated[
        list[float] | None, typer.Option(help="Share of the weights of each --blend, 0 to 1.")
    ] = None,
    calibrate_classes: Annotated[
        bool,
        typer.Option(help="Fit a bias for each class on the validation sets, each of which counts alike."),
    ] = False,
    max_loss: Annotated[float, typer.Option(help="Points of grass IoU that INT8 may cost.")] = 0.5,
    as_json: Json = False,
) -> None:
    """Export a network to ONNX with its metadata; measure what INT8 costs; calibrate its confidence.

    Example: swardmap export run1/best.pt --data ~/photos -o lawn.onnx
    """
    require("torch", "train")
    from swardmap.train.release import release

    paths, shares = blend or [], blend_share or []
    if len(paths) != len(shares) or not all(0 <= share <= 1 for share in shares):
        raise typer.BadParameter("expected one --blend-share of 0 to 1 for each --blend")
    result = release(
        checkpoint,
        data,
        out,
        int8,
        images,
        size,
        grass_bias,
        tuple(zip(paths, shares, strict=True)),
        calibrate_classes,
    )
    if as_json:
        print(json.dumps(result, indent=2))
    else:
        _print(result)
    lost = result.get("int8_loss_points")
    if lost is not None and lost > max_loss:
        raise ModelError(
            f"INT8 costs {lost:.2f} points of grass IoU, more than {max_loss}: use more calibration images, "
            "or --no-int8"
        )


def _print(result: dict[str, Any]) -> None:
    print(f"{result['file']}  {result['bytes'] / 1e6:.1f} MB  temperature {result['temperature']:.3f}")
    print(f"largest difference from torch: {result['difference']:.2g} of a logit (float32)")
    for name in ("float32", "int8"):
        figures = result.get(name)
        if figures:
            told = "  ".join(f"{k} {v:.4f}" if v is not None else f"{k} -" for k, v in figures.items())
            print(f"{name:8} {told}")
    if result.get("int8_loss_points") is not None:
        print(f"INT8 costs {result['int8_loss_points']:.2f} points of grass IoU")

"""`swardmap export`: a checkpoint to an .onnx file that says all about itself."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from swardmap.cli.options import Json
from swardmap.errors import ModelError, require


def export(
    checkpoint: Annotated[
        Path,
        typer.Argument(
            help="best.pt or last.pt of `swardmap train`; with --recipe, an .onnx file that is only to learn "
            "which images it knows."
        ),
    ],
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
    person_bias: Annotated[
        float, typer.Option(help="Added to persons' logit: fewer persons called other, more others persons.")
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
    familiar: Annotated[
        bool, typer.Option(help="Teach the file which images it knows (docs/models.md); takes minutes.")
    ] = True,
    recipe: Annotated[
        Path | None, typer.Option(help="Recipe of an .onnx file, for what it knows.", show_default=False)
    ] = None,
    max_loss: Annotated[float, typer.Option(help="Points of grass IoU that INT8 may cost.")] = 0.5,
    as_json: Json = False,
) -> None:
    """Export a network to ONNX with its metadata; measure what INT8 costs; calibrate its confidence.

    Example: swardmap export run1/best.pt --data ~/photos -o lawn.onnx
    """
    require("torch", "train")
    from swardmap.train.release import release

    if recipe is not None:
        _tell_familiar(_taught(checkpoint, recipe, data, out), as_json)
        return
    paths, shares = blend or [], blend_share or []
    if len(paths) != len(shares) or not all(0 <= share <= 1 for share in shares):
        raise typer.BadParameter("expected one --blend-share of 0 to 1 for each --blend")
    partial = out.with_suffix(".partial.onnx")
    try:
        result = release(
            checkpoint,
            data,
            partial,
            int8,
            images,
            size,
            grass_bias,
            tuple(zip(paths, shares, strict=True)),
            calibrate_classes,
            familiar,
            person_bias=person_bias,
        )
        lost = result.get("int8_loss_points")
        if lost is not None and lost > max_loss:
            raise ModelError(
                f"INT8 costs {lost:.2f} points of grass IoU, more than {max_loss}, so {out} is not written: "
                "use more calibration images, or --no-int8"
            )
        partial.replace(out)
    finally:
        partial.unlink(missing_ok=True)
    result["file"] = str(out)
    if as_json:
        print(json.dumps(result, indent=2))
    else:
        _print(result)


def _taught(network: Path, recipe: Path, data: Path, out: Path) -> dict[str, Any]:
    """Copy a network file and teach the copy which images it knows; it appears whole, or not at all."""
    from swardmap.train.export import read_spec
    from swardmap.train.recipe import load_recipe
    from swardmap.train.release import make_familiar

    if network.suffix.lower() != ".onnx":
        raise typer.BadParameter("expected an .onnx file with --recipe; a checkpoint holds its own")
    read_spec(network)
    out.parent.mkdir(parents=True, exist_ok=True)
    partial = out.with_suffix(".familiar.onnx")
    try:
        partial.write_bytes(network.read_bytes())
        figures = make_familiar(partial, load_recipe(recipe), data)
        partial.replace(out)
    finally:
        partial.unlink(missing_ok=True)
    return figures


def _tell_familiar(figures: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print(json.dumps(figures, indent=2))
        return
    for key, told in (("refused", "known images called unfamiliar"), ("noticed", "spoilt ones noticed")):
        shares = ", ".join(f"{name} {100 * share:.1f} %" for name, share in figures[key].items())
        print(f"{told}: {shares}")


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
    if result.get("unfamiliar"):
        _tell_familiar(result["unfamiliar"], as_json=False)

"""The training loop: one clear loop that runs on a CPU, a GPU or many, and goes on after a kill.

A step depends only on the weights before it, the recipe and the step's number: data, augmentation and
dropout are drawn from (seed, step). So a run that was killed and resumed ends with the same weights.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812 - torch's own name for it

from swardmap.errors import ConfigError
from swardmap.io.staging import sweep_inside
from swardmap.labels import VOID_ID, LabelSet, Role
from swardmap.models import bundled_network
from swardmap.models.network_io import decide, preprocess
from swardmap.train.build import build_network, network_spec
from swardmap.train.checkpoint import Run, begin_from, make_folder, restore, save_progress, save_start
from swardmap.train.data import Codes, PhotoSet, draw_batch, load_photos, make_codes
from swardmap.train.kept_views import Encoded, KeptViews, check_encoder
from swardmap.train.loss import set_loss
from swardmap.train.networks import DeepLabV3Plus
from swardmap.train.onnx_weights import load_onnx_weights
from swardmap.train.photos import Photo
from swardmap.train.pictures import write_pictures
from swardmap.train.processes import all_reduce_gradients, join_processes
from swardmap.train.recipe import Recipe
from swardmap.train.score import Score
from swardmap.types import Segmentation

STATISTICS_BATCHES = 8
"""Of 8 views each: enough for the statistics of the batch norms of a network that came from a file."""
FROZEN_STATISTICS_BATCHES = 2
"""The same where they stay as they are: then they only shape how fast a weight learns."""

Report = Callable[[Mapping[str, Any]], None]


def start_run(recipe: Recipe, device: torch.device, pretrained: bool = True) -> Run:
    """A run at step 0."""
    network = build_network(recipe, pretrained).to(device, memory_format=torch.channels_last)
    classes = recipe.network.auxiliary_classes
    auxiliary = nn.Conv2d(recipe.network.decoder_channels, classes, 1) if classes else nn.Identity()
    auxiliary = auxiliary.to(device)
    schedule = recipe.schedule
    encoder = [p for p in network.encoder.parameters() if p.requires_grad]
    rest = [p for n, p in network.named_parameters() if not n.startswith("encoder.") and p.requires_grad]
    groups = [
        {"params": encoder, "lr": schedule.encoder_rate, "peak": schedule.encoder_rate},
        {
            "params": rest + list(auxiliary.parameters()),
            "lr": schedule.decoder_rate,
            "peak": schedule.decoder_rate,
        },
    ]
    optimizer = torch.optim.AdamW(groups, weight_decay=schedule.weight_decay)
    average = {k: v.detach().clone() for k, v in network.state_dict().items()}
    return Run(recipe, device, network, auxiliary, average, optimizer)


def train(recipe: Recipe, root: Path, out: Path, report: Report, device: str = "cpu") -> Run:
    """Train until the recipe's last step; goes on from `out/last.pt` if it is there.

    Args:
        recipe: what and how.
        root: folder the recipe's data folders are in.
        out: gets `last.pt`, `best.pt`, `curve.json`, `curve.png`, `examples.png`; `start.pt` if the recipe
            begins from other weights.
        report: told of each step's loss and each validation's figures.
        device: as torch names it.

    Raises:
        ConfigError: if `out/last.pt` is of another recipe, or torch cannot run on the device.
        InputError: for data that is missing or damaged.
        OutputError: if `out` cannot be written.
    """
    make_folder(out)
    rank, world = join_processes(device)
    if rank == 0:
        sweep_inside(out)  # what a killed run left
    last = out / "last.pt"
    run = start_run(recipe, torch.device(device), pretrained=not (last.exists() or recipe.start))
    learn, check = load_photos(recipe, root, validation=False), load_photos(recipe, root, validation=True)
    if last.exists():
        restore(run, last)
    elif recipe.start:
        _begin(run, root, learn)
        if rank == 0:
            save_start(run, out / "start.pt")
    codes = make_codes(recipe)
    while run.step < recipe.schedule.steps:
        loss = train_step(run, learn, codes, rank, world)
        if rank != 0:
            continue
        report({"step": run.step, "loss": loss})
        if run.step % recipe.schedule.check_every == 0 or run.step == recipe.schedule.steps:
            network = averaged_network(run)
            figures = validate(network, recipe, check, run.device)
            run.history.append({"step": run.step, "loss": loss, **figures})
            report(run.history[-1])
            write_pictures(out, run.history, _examples(network, recipe, check, run.device))
            save_progress(run, out, selection_score(figures, check, recipe.network.label_set))
    return run


def _begin(run: Run, root: Path, sets: Sequence[PhotoSet]) -> None:
    """Take the weights that the recipe says it starts from: a checkpoint's, or those of an .onnx file."""
    start = run.recipe.start
    if start != "auto" and not start.endswith(".onnx"):
        begin_from(run, root / start)
        return
    path = bundled_network() if start == "auto" else root / start
    if path is None:
        raise ConfigError(f"recipe {run.recipe.name}: start: auto, but this package holds no network")
    batches = FROZEN_STATISTICS_BATCHES if run.recipe.schedule.frozen_norms else STATISTICS_BATCHES
    views = (draw_batch(sets, run.recipe, range(8), step) for step in range(batches))
    load_onnx_weights(path, run.network, network_spec(run.recipe), (_tensors(v, run)[0] for v in views))
    run.average = {k: v.detach().clone() for k, v in run.network.state_dict().items()}


def train_step(run: Run, sets: Sequence[PhotoSet], codes: Codes, rank: int = 0, world: int = 1) -> float:
    """One step, of which this process takes every `world`-th view; returns the loss."""
    schedule = run.recipe.schedule
    torch.manual_seed(schedule.seed * 1_000_003 + run.step)  # dropout
    for group in run.optimizer.param_groups:
        group["lr"] = group["peak"] * _warmup_cosine(run.step, schedule.warmup, schedule.steps)
    run.network.train()
    if schedule.frozen_norms:
        freeze_norms(run.network)
    precision = quick_precision(run.device.type) if schedule.precision == "auto" else schedule.precision
    half = torch.autocast(run.device.type, torch.bfloat16, enabled=precision == "bf16")
    with half:
        low, high, view_codes, fine = _encoded(run, sets, range(rank, schedule.batch, world))
        features = run.network.decoder(low, high)
        logits = run.network.segmentation_head(features)
        finer = run.auxiliary(features)
    logits = F.interpolate(logits.float(), size=view_codes.shape[-2:], mode="bilinear", align_corners=False)
    loss = set_loss(logits, view_codes, codes)
    if run.recipe.network.auxiliary_classes:
        small = fine[:, 2::4, 2::4].long()
        total = F.cross_entropy(finer.float(), small, ignore_index=255, reduction="sum")
        loss = loss + schedule.auxiliary_weight * total / (small != 255).sum().clamp(min=1)
    run.optimizer.zero_grad(set_to_none=True)
    loss.backward()
    all_reduce_gradients(run.optimizer, world)
    nn.utils.clip_grad_norm_(run.network.parameters(), 5.0)
    run.optimizer.step()
    run.step += 1
    _update_average(run)
    return float(loss.detach())


def _encoded(run: Run, sets: Sequence[PhotoSet], indices: range) -> Encoded:
    """Features and codes of the views of this step."""

    def made(number: int) -> Encoded:
        image, codes, fine = _tensors(draw_batch(sets, run.recipe, indices, number), run)
        return *run.network.encoder(image), codes, fine

    batches = run.recipe.schedule.kept_batches
    if not batches:
        return made(run.step)
    if run.kept is None:
        check_encoder(run.recipe, run.network.encoder)
        run.kept = KeptViews(batches, len(indices), run.recipe.schedule.seed)
    return run.kept.at(run.step, made)


def freeze_norms(network: nn.Module) -> None:
    """Let batch norms go by the statistics they have, until the next `network.train()`."""
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.eval()


def quick_precision(device: str) -> str:
    """`bf16` where the device computes with it quickly, else `fp32`."""
    if device.startswith("cuda"):
        return "bf16" if torch.cuda.is_bf16_supported() else "fp32"
    quick = getattr(torch.ops.mkldnn, "_is_mkldnn_bf16_supported", None)
    return "bf16" if quick is not None and quick() else "fp32"


@torch.no_grad()
def validate(
    network: nn.Module, recipe: Recipe, sets: Sequence[PhotoSet], device: torch.device
) -> dict[str, Any]:
    """Figures on whole photos, at the photo's own size: of all, and of each set if there are several."""
    spec = network_spec(recipe)
    ids = np.full(256, VOID_ID, np.uint8)
    ids[: len(spec.channel_ids)] = spec.channel_ids
    total = Score.empty(spec.channel_ids, spec.label_set)
    figures: dict[str, Any] = {}
    for photo_set in sets:
        score = Score.empty(spec.channel_ids, spec.label_set)
        for photo in photo_set.photos:
            score = score.plus(ids[photo.codes], predict(network, recipe, photo, device).labels)
        total = replace(total, counts=total.counts + score.counts)
        if len(sets) > 1:
            figures |= {f"{photo_set.config.name}.{k}": v for k, v in score.figures().items()}
    return dict(total.figures()) | figures if sets else {}


@torch.no_grad()
def predict(network: nn.Module, recipe: Recipe, photo: Photo, device: torch.device) -> Segmentation:
    """The network's mask of a photo, stretched as the shipped network will see it, at the photo's size."""
    spec = network_spec(recipe)
    buffer = np.zeros((1, 3, spec.height, spec.width), np.float32)
    preprocess(photo.image, spec, buffer)
    logits = network(torch.from_numpy(buffer).to(device)).float().cpu().numpy()
    labels, confidence = decide(logits, spec)
    return Segmentation(labels, spec.label_set, confidence).resized_to(*photo.codes.shape)


def selection_score(figures: Mapping[str, Any], sets: Sequence[PhotoSet], label_set: LabelSet) -> float:
    """One number to choose the best checkpoint by: grass found, obstacles not run over, persons seen.

    The mean over the validation sets by their weights, however many photos each has.
    """
    prefixes = [f"{s.config.name}." for s in sets] if len(sets) > 1 else [""] * len(sets)
    weights = [s.config.weight for s in sets]
    values = []
    for prefix in prefixes:
        free, person = (
            [figures.get(f"{prefix}{c.name}_iou") or 0.0 for c in label_set.classes if c.role is role]
            for role in (Role.FREE, Role.PERSON)
        )
        run_over = figures.get(f"{prefix}obstacle_called_grass") or 0.0
        values.append(_mean(free) + 0.25 * _mean(person) - run_over)
    return float(np.average(values, weights=weights)) if sum(weights) > 0 else 0.0


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else 0.0


def averaged_network(run: Run) -> DeepLabV3Plus:
    """The network with the running mean of its weights, ready to use."""
    network = build_network(run.recipe, pretrained=False)
    network.load_state_dict(run.average)
    return network.to(run.device).eval()


def _tensors(views: Sequence[Photo], run: Run) -> tuple[Tensor, Tensor, Tensor]:
    spec = network_spec(run.recipe)
    images = torch.from_numpy(np.stack([v.image for v in views])).to(run.device)
    mean, std = (torch.tensor(v, device=run.device) for v in (spec.mean, spec.std))
    x = ((images.float() / 255 - mean) / std).permute(0, 3, 1, 2)  # channels-last as it lies
    codes, fine = (torch.from_numpy(np.stack([getattr(v, k) for v in views])) for k in ("codes", "fine"))
    return x, codes.to(run.device), fine.to(run.device)


@torch.no_grad()
def _examples(
    network: nn.Module, recipe: Recipe, sets: Sequence[PhotoSet], device: torch.device, count: int = 12
) -> list[tuple[Photo, Segmentation]]:
    photos = [p for s in sets for p in s.photos]
    return [(p, predict(network, recipe, p, device)) for p in photos[:: max(1, len(photos) // count)]]


def _warmup_cosine(step: int, warmup: int, steps: int) -> float:
    """Share of the peak learning rate: linear warm-up, then half a cosine down to 0."""
    if step < warmup:
        return (step + 1) / warmup
    return 0.5 * (1 + float(np.cos(np.pi * (step - warmup) / max(1, steps - warmup))))


@torch.no_grad()
def _update_average(run: Run) -> None:
    decay = min(run.recipe.schedule.averaging, (1 + run.step) / (10 + run.step))
    for key, value in run.network.state_dict().items():
        kept = run.average[key]
        if kept.is_floating_point():
            kept.lerp_(value, 1 - decay)
        else:
            kept.copy_(value)

"""What the detector is trained to minimise.

Two things differ from the published recipe, because a network this small starts from nothing and has hours, not weeks:

- every cell of the encoder's maps near the middle of a thing is told what it sees and where that ends (as detectors
  without queries are trained), not only the few cells that a one-to-one matching picks;
- the boxes proposed by the encoder get gradients (transformers' own loss cuts them off).

The decoder is trained by one-to-one matching as published: focal loss on tokens, L1 and generalised IoU on boxes.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from perception.detection.devices import load_package

ALPHA = 0.25  # of the focal loss
CLASS_WEIGHT, BOX_WEIGHT, IOU_WEIGHT = 2.0, 5.0, 2.0


def corners(boxes: Any) -> Any:
    """(centre x, centre y, width, height) as (x0, y0, x1, y1), any leading shape."""
    torch = load_package("torch")
    centre, half = boxes[..., :2], boxes[..., 2:] / 2
    return torch.cat([centre - half, centre + half], -1)


def paired_giou(a: Any, b: Any) -> Any:
    """Generalised IoU of boxes (x0, y0, x1, y1) one to one, shape (n,); -1..1."""
    torch = load_package("torch")
    shared = (torch.min(a[:, 2:], b[:, 2:]) - torch.max(a[:, :2], b[:, :2])).clamp(min=0).prod(1)
    union = (a[:, 2:] - a[:, :2]).clamp(min=0).prod(1) + (b[:, 2:] - b[:, :2]).clamp(min=0).prod(1) - shared
    around = (torch.max(a[:, 2:], b[:, 2:]) - torch.min(a[:, :2], b[:, :2])).prod(1)
    return shared / (union + 1e-7) - (around - union) / (around + 1e-7)


def all_giou(a: Any, b: Any) -> Any:
    """Generalised IoU of every pair, shape (n, m)."""
    n, m = len(a), len(b)
    return paired_giou(a[:, None].expand(n, m, 4).reshape(-1, 4), b[None].expand(n, m, 4).reshape(-1, 4)).view(n, m)


def focal(logits: Any, targets: Any, weight: Any) -> Any:
    """Sum of the focal loss with gamma 2 (Lin et al. 2017, eq. 5) over all entries of weight 1."""
    torch = load_package("torch")
    logits = logits.float().masked_fill(weight == 0, 0.0)
    p = logits.sigmoid()
    entropy = torch.nn.functional.binary_cross_entropy_with_logits(logits, targets, reduction="none")
    right = p * targets + (1 - p) * (1 - targets)
    return ((ALPHA * targets + (1 - ALPHA) * (1 - targets)) * entropy * (1 - right) ** 2 * weight).sum()


def box_loss(boxes: Any, wanted: Any) -> Any:
    """L1 and generalised IoU of boxes one to one, summed."""
    return (
        BOX_WEIGHT * (boxes - wanted).abs().sum()
        + IOU_WEIGHT * (1 - paired_giou(corners(boxes), corners(wanted))).sum()
    )


def matched_loss(logits: Any, boxes: Any, wanted: Sequence[Any], tokens: Sequence[Any], text: Any) -> Any:
    """Loss of queries against things, matched one to one.

    Args:
        logits: Of tokens, shape (batch, queries, tokens).
        boxes: 0..1, (cx, cy, w, h), shape (batch, queries, 4).
        wanted: True boxes of each picture, each (things, 4).
        tokens: Which tokens name each thing, 0 or 1, each (things, tokens).
        text: Which tokens are text, bool, shape (batch, tokens).
    """
    torch = load_package("torch")
    targets = torch.zeros_like(logits, dtype=torch.float32)
    chosen, true = [], []
    for i, things in enumerate(wanted):
        if not len(things):
            continue
        with torch.no_grad():
            p = logits[i].float().sigmoid()
            gain = ALPHA * (1 - p) ** 2 * -(p + 1e-8).log() - (1 - ALPHA) * p**2 * -(1 - p + 1e-8).log()
            share = tokens[i] / tokens[i].sum(1, keepdim=True).clamp(min=1)
            cost = CLASS_WEIGHT * gain @ share.t() + BOX_WEIGHT * torch.cdist(boxes[i], things, p=1)
            cost = cost - IOU_WEIGHT * all_giou(corners(boxes[i]), corners(things))
            query, thing = linear_sum_assignment(np.nan_to_num(cost.numpy(), nan=1e4, posinf=1e4))
        targets[i, query] = tokens[i][thing]
        chosen.append(boxes[i, query])
        true.append(things[thing])
    weight = text[:, None, :].float().expand_as(targets)
    loss = CLASS_WEIGHT * focal(logits, targets, weight)
    count = sum(len(w) for w in wanted)
    if chosen:
        loss = loss + box_loss(torch.cat(chosen), torch.cat(true))
    return loss / max(count, 1)


def dense_loss(logits: Any, boxes: Any, owner: Any, wanted: Sequence[Any], tokens: Sequence[Any], text: Any) -> Any:
    """Loss of every cell of the encoder's maps.

    Args:
        logits, boxes: Of cells, shapes (batch, cells, tokens) and (batch, cells, 4).
        owner: Number of the thing that each cell answers for, -1 none, -2 not judged; int, shape (batch, cells).
        wanted, tokens, text: As for `matched_loss`.
    """
    torch = load_package("torch")
    targets = torch.zeros_like(logits, dtype=torch.float32)
    weight = text[:, None, :].float() * (owner != -2)[..., None].float()
    chosen, true = [], []
    for i, things in enumerate(wanted):
        cells = (owner[i] >= 0).nonzero()[:, 0]
        if len(cells):
            mine = owner[i][cells]
            targets[i, cells] = tokens[i][mine]
            chosen.append(boxes[i, cells])
            true.append(things[mine])
    count = max(sum(len(c) for c in chosen), 1)
    loss = CLASS_WEIGHT * focal(logits, targets, weight)
    if chosen:
        loss = loss + box_loss(torch.cat(chosen), torch.cat(true))
    return loss / count


def cell_owners(
    labels: np.ndarray, boxes: np.ndarray, numbers: Sequence[int], shapes: Sequence[tuple[int, int]]
) -> np.ndarray:
    """Which thing every cell of the encoder's maps answers for.

    Small things are answered for on fine maps, large ones on coarse maps, with an octave's overlap; the size that
    counts is the root of the visible area, so that a long thin bar is small. A cell answers for
    a thing when its middle lies in the middle half of the thing's box and on the thing; at least the cell nearest to
    the box's middle does. Other cells on the thing are not judged.

    Args:
        labels: Label picture, shape (height, width).
        boxes: (x0, y0, x1, y1) in [px] of the things asked for, shape (n, 4).
        numbers: Their labels.
        shapes: (rows, columns) of each map, the finest first.

    Returns:
        int, shape (cells,): thing, -1 none, -2 not judged.
    """
    height, width = labels.shape
    maps = []
    for level, (rows, columns) in enumerate(shapes):
        y = (np.arange(rows) + 0.5) * height / rows
        x = (np.arange(columns) + 0.5) * width / columns
        on = labels[np.minimum(y.astype(int), height - 1)[:, None], np.minimum(x.astype(int), width - 1)[None]]
        owner = np.full((rows, columns), -1)
        stride = width / columns
        order = np.argsort(-(boxes[:, 2:] - boxes[:, :2]).prod(1)) if len(boxes) else []
        for k in order:  # smaller things last: they lie in front
            x0, y0, x1, y1 = boxes[k]
            side = float(np.sqrt((labels == numbers[k]).sum()))
            owner[(on == numbers[k]) & (owner < 0)] = -2
            low = 0.0 if level == 0 else 3.0 * stride
            high = np.inf if level == len(shapes) - 1 else 9.0 * stride
            if not low <= side < high:
                continue
            cx, cy, w, h = (x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0
            near = (np.abs(x[None] - cx) <= w / 4) & (np.abs(y[:, None] - cy) <= h / 4) & (on == numbers[k])
            if not near.any():
                near[
                    int(np.clip(cy / height * rows, 0, rows - 1)), int(np.clip(cx / width * columns, 0, columns - 1))
                ] = True
            owner[near] = k
        maps.append(owner.ravel())
    return np.concatenate(maps)

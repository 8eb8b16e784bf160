"""Pictures of what was perceived, for people: masks, upright solids, names and scores over the colour picture."""

import cv2
import numpy as np

from perception.estimates import ObjectEstimate, SceneEstimate
from perception.frames import RgbdFrame

# Eight colours that stay apart for most colour-blind readers (Okabe and Ito), RGB.
PALETTE = (
    (0, 114, 178),
    (213, 94, 0),
    (0, 158, 115),
    (204, 121, 167),
    (86, 180, 233),
    (230, 159, 0),
    (240, 228, 66),
    (90, 90, 90),
)
# No colour of the depth picture's scale (Cividis: blue to yellow) comes near these.
MISSING, MISSING_STRIPE = (214, 30, 140), (120, 10, 80)
UNNAMED = (200, 0, 0)  # of what nobody named; no colour of the palette comes near it
FONT = cv2.FONT_HERSHEY_SIMPLEX


def overlay(frame: RgbdFrame, scene: SceneEstimate) -> np.ndarray:
    """Draw a scene estimate over the picture of one camera.

    Boxes and masks are drawn where this camera is among an object's evidence; solids of the others are projected
    all the same. What nobody named is red and without a score. A corner says which detector and segmenter looked, and
    what was looked for in vain.

    Returns:
        RGB, uint8, shape (height, width, 3).
    """
    picture = frame.colour.copy()
    paints = {o.name: PALETTE[i % len(PALETTE)] if o.named else UNNAMED for i, o in enumerate(scene.objects)}
    for o in scene.objects:
        for item in o.evidence:
            if item.camera == frame.camera and item.mask.shape == picture.shape[:2]:
                _tint(picture, item.mask, paints[o.name])
    for o in scene.objects:
        _draw_solid(picture, frame, o, paints[o.name])
    places = {o.name: _place_in_picture(frame, o) for o in scene.objects}
    taken = [place for place in places.values() if place is not None]
    for o in scene.objects:
        place = places[o.name]
        if place is not None:
            _draw_label(picture, o, paints[o.name], place, taken)
    _draw_footer(picture, scene)
    return picture


def depth_picture(frame: RgbdFrame) -> tuple[np.ndarray, tuple[float, float]]:
    """Depth in colours from near (light) to far (dark); where it is missing, magenta stripes, so that holes show.

    Returns:
        RGB, uint8, shape (height, width, 3), and the depths in [m] that the lightest and the darkest colour stand for:
        the 2 % and 98 % quantiles of what is known; (0, 0) where nothing is.
    """
    known = frame.valid_depth
    near, far = np.quantile(frame.depth[known], (0.02, 0.98)) if known.any() else (0.0, 0.0)
    share = np.clip((np.where(known, frame.depth, far) - near) / max(far - near, 1e-6), 0.0, 1.0)
    picture = cv2.applyColorMap((255 * (1.0 - share)).astype(np.uint8), cv2.COLORMAP_CIVIDIS)[:, :, ::-1].copy()
    row, column = np.indices(known.shape)
    striped = (row + column) % 8 < 4
    picture[~known] = MISSING
    picture[~known & striped] = MISSING_STRIPE
    return picture, (float(near), float(far))


def solid_outline(o: ObjectEstimate, segments: int = 32) -> list[np.ndarray]:
    """Closed lines that show a solid, in the world in [m], each of shape (n, 3)."""
    half = np.asarray(o.extents) / 2
    lines: list[np.ndarray] = []
    if o.shape == "box":
        ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[:2]
        low, high = np.c_[ring, np.full(4, -half[2])], np.c_[ring, np.full(4, half[2])]
        lines = [low, high, *(np.stack([a, b]) for a, b in zip(low, high, strict=True))]
    else:
        t = np.linspace(0.0, 2.0 * np.pi, segments, endpoint=False)
        flat = np.stack([np.cos(t), np.sin(t)], -1)
        if o.shape == "cylinder":
            lines = [np.c_[flat * half[:2], np.full(segments, z)] for z in (-half[2], half[2])]
            lines += [np.array([[s * half[0], 0, -half[2]], [s * half[0], 0, half[2]]]) for s in (-1, 1)]
        else:
            zero = np.zeros(segments)
            lines = [
                np.c_[flat * half[:2], zero],
                np.c_[flat[:, 0] * half[0], zero, flat[:, 1] * half[2]],
                np.c_[zero, flat[:, 0] * half[1], flat[:, 1] * half[2]],
            ]
    pose = np.asarray(o.world_T_object)
    return [line @ pose[:3, :3].T + pose[:3, 3] for line in lines]


def project(points: np.ndarray, frame: RgbdFrame) -> np.ndarray | None:
    """Pixels (u, v) of world points [m], shape (n, 2), or None when one of them is not in front of the camera."""
    pose = frame.world_T_camera
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    if (local[:, 2] < 0.02).any():
        return None
    k = frame.intrinsics
    return np.stack([k.fx * local[:, 0] / local[:, 2] + k.cx, k.fy * local[:, 1] / local[:, 2] + k.cy], -1)


def _tint(picture: np.ndarray, mask: np.ndarray, paint: tuple[int, int, int]) -> None:
    picture[mask] = (0.62 * picture[mask] + 0.38 * np.array(paint)).astype(np.uint8)
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, contours, -1, paint, 1, cv2.LINE_AA)


def _draw_solid(picture: np.ndarray, frame: RgbdFrame, o: ObjectEstimate, paint: tuple[int, int, int]) -> None:
    for line in solid_outline(o):
        pixels = project(line, frame)
        if pixels is None or np.abs(pixels).max() > 1e5:
            continue
        # Sub-pixel positions: OpenCV takes fixed-point numbers with `shift` fractional bits.
        fixed = np.round(pixels * 16).astype(np.int32).reshape(-1, 1, 2)
        closed = len(line) > 2
        cv2.polylines(picture, [fixed], closed, (255, 255, 255), 3, cv2.LINE_AA, shift=4)
        cv2.polylines(picture, [fixed], closed, paint, 1, cv2.LINE_AA, shift=4)


Rect = tuple[float, float, float, float]


def _draw_label(
    picture: np.ndarray, o: ObjectEstimate, paint: tuple[int, int, int], at: Rect, taken: list[Rect], shift: int = 6
) -> None:
    """Name, score and size beside the object, where it covers least of what is drawn already.

    Args:
        picture: To draw into.
        o: The object.
        paint: Its colour.
        at: (x0, y0, x1, y1) of the object in [px].
        taken: The same of all objects and labels so far; the new label is added.
        shift: Gap to the object in [px].
    """
    height, width = picture.shape[:2]
    size = 100 * np.asarray(o.extents)
    score = f" {o.score:.2f}" if o.named else ""
    text = f"{o.phrase}{' ?' if o.doubts else ''}{score}  {size[0]:.1f} x {size[1]:.1f} x {size[2]:.1f} cm"
    scale = 0.42 * max(1.0, height / 720)
    (w, h), _ = cv2.getTextSize(text, FONT, scale, 1)
    wide, high = w + 8, h + 10
    x0, y0, x1, y1 = at
    middle = (x0 + x1 - wide) / 2
    corners = [
        (middle, y0 - high - shift),
        (middle, y1 + shift),
        (x1 + shift, (y0 + y1 - high) / 2),
        (x0 - wide - shift, (y0 + y1 - high) / 2),
        (middle, y0 - 2 * high - 2 * shift),
        (middle, y1 + high + 2 * shift),
    ]
    boxes = []
    for x, y in corners:
        x, y = float(np.clip(x, 2, max(2, width - wide - 2))), float(np.clip(y, 2, height - high - 42))
        boxes.append((x, y, x + wide, y + high))
    best = min(boxes, key=lambda box: sum(_shared_area(box, other) for other in taken))
    taken.append(best)
    left, top, right, bottom = (round(v) for v in best)
    cv2.rectangle(picture, (left, top), (right, bottom), (255, 255, 255), -1)
    cv2.rectangle(picture, (left, top), (right, bottom), paint, 1, cv2.LINE_AA)
    cv2.putText(picture, text, (left + 4, bottom - 5), FONT, scale, (20, 20, 20), 1, cv2.LINE_AA)


def _shared_area(a: Rect, b: Rect) -> float:
    return max(0.0, min(a[2], b[2]) - max(a[0], b[0])) * max(0.0, min(a[3], b[3]) - max(a[1], b[1]))


def _place_in_picture(frame: RgbdFrame, o: ObjectEstimate) -> Rect | None:
    """Box around the projected solid in [px], or None when it lies outside of the picture."""
    pixels = project(np.concatenate(solid_outline(o)), frame)
    if pixels is None:
        return None
    (x0, y0), (x1, y1) = pixels.min(0), pixels.max(0)
    if x1 < 0 or y1 < 0 or x0 > frame.intrinsics.width or y0 > frame.intrinsics.height:
        return None
    return float(x0), float(y0), float(x1), float(y1)


def _draw_footer(picture: np.ndarray, scene: SceneEstimate) -> None:
    """A band at the foot: who looked, what is doubted, and what was not seen."""
    height, width = picture.shape[:2]
    scale = 0.38 * max(1.0, height / 720)
    lines = [scene.source]
    doubted = [o for o in scene.objects if o.doubts]
    if doubted:
        lines.append("doubted: " + "; ".join(f"{o.name} ({', '.join(o.doubts)})" for o in doubted))
    if scene.unseen:
        lines.append("not seen: " + "; ".join(f"{u.name} ({u.reason})" for u in scene.unseen))
    step = round(40 * scale)
    band = picture[height - step * len(lines) - 4 :]
    band[:] = (0.25 * band).astype(np.uint8)
    for i, line in enumerate(lines):
        # The reason must not run out of the picture: cut it where the picture ends.
        while cv2.getTextSize(line, FONT, scale, 1)[0][0] > width - 12 and len(line) > 8:
            line = line[:-4].rstrip() + "..."
        y = height - 8 - step * (len(lines) - 1 - i)
        cv2.putText(picture, line, (6, y), FONT, scale, (240, 240, 240), 1, cv2.LINE_AA)

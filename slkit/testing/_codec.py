"""The conformance suite of codecs."""

from __future__ import annotations

import dataclasses
import pickle
import re
import tracemalloc
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from slkit import registry
from slkit.data import Correspondences, Frames, Image
from slkit.errors import SlkitError
from slkit.protocols import Bounds, Codec
from slkit.testing._require import require, require_refusal
from slkit.testing._views import View, views_of

_ROLE = re.compile(r"(white|black|xy?|y)(_[\w.-]+)?")
_DEPTHS = ("uint8", "uint16")
_SIGMAS = 5.0
_INLIERS = 0.95
_LEAST_COVER = 0.75
_BLOCK_PX = 8
_STRAY = 0.01
_DARK_PX = 3.0
# A codec may allow a cell or so beyond its bounds: a column of a small projector is one percent of its pixels.
_OUT_OF_BOUNDS = 0.03
# Fewer patterns than these are hardly worth being lazy about.
_MANY = 6


def check_codec(codec: Codec, tolerance_px: float = 1.5, bounded: bool = False) -> None:
    """Try whether a codec keeps the promises that the rest of slkit relies on.

    codec: with parameters of your choice; a small projector, such as 160 x 120 px, makes it quick. tolerance_px: what
    the median error may be, in projector px. bounded: the codec cannot decode without bounds; it is given some.
    Errors: AssertionError with a sentence that says which promise is broken.
    """
    _check_parameters(codec)
    patterns = _check_patterns(codec)
    fresh: Codec = registry.create(type(codec), registry.parameters_of(codec), "check_codec")
    height, width = patterns[0].shape[:2]
    views = views_of((width, height))
    for view in views:
        frames = view.capture(patterns)
        found = _check_reading(fresh, frames, view.bounds(4.0) if bounded else None)
        _check_form(codec, found, view)
        _check_truth(found, view, tolerance_px)
    straight = views[0]
    frames = straight.capture(patterns)
    bounds = straight.bounds(4.0) if bounded else None
    found = fresh.decode(frames, bounds)
    _check_depths(fresh, frames, bounds, found, straight)
    _check_bounds(fresh, frames, found, straight, bounded)
    _check_refusals(fresh, frames, bounds)
    _check_lit(fresh, frames, straight)


def _check_parameters(codec: Any) -> None:
    require(isinstance(codec, Codec), "a codec must have the methods encode, decode and lit")
    require(dataclasses.is_dataclass(codec), "a codec must be a dataclass whose fields are its parameters")
    frozen = getattr(type(codec), "__dataclass_params__").frozen  # noqa: B009
    require(frozen, "a codec must be a frozen dataclass: its parameters never change")
    again = registry.create(type(codec), registry.parameters_of(codec), "check_codec")
    require(again == codec, "a codec made again from its own parameters must equal the first")
    require(pickle.loads(pickle.dumps(codec)) == codec, "a codec must survive pickling, for work in several processes")


def _check_patterns(codec: Codec) -> Frames:
    patterns = codec.encode()
    names = patterns.names
    require(len(names) > 0, "encode() must give at least one pattern")
    require(len(set(names)) == len(names), "pattern names must be unique: " + Counter(names).most_common(1)[0][0])
    for name in names:
        role = _ROLE.fullmatch(name)
        require(role, f"pattern name {name!r} must start with its role: white, black, x_, y_ or xy_")
    shape = patterns[0].shape[:2]
    for name, image in zip(names, patterns, strict=True):
        require(image.shape[:2] == shape, f"pattern {name} has another size than {names[0]}")
        require(image.dtype.name in _DEPTHS, f"pattern {name} must be uint8 or uint16, not {image.dtype}")
    projector = getattr(codec, "projector", None)
    require(
        projector is None or tuple(projector) == shape[::-1],
        f"patterns are {shape[1]} x {shape[0]} px, but the codec's projector is {projector}",
    )
    again = codec.encode()
    same = again.names == names and all(np.array_equal(a, b) for a, b in zip(patterns, again, strict=True))
    require(same, "encode() must give the same patterns every time")
    held, drawn = _memory_of(codec.encode), sum(image.nbytes for image in patterns)
    require(
        len(names) < _MANY or held < drawn / 2,
        "encode() must draw a pattern when it is asked for, not all at once",
    )
    return patterns


def _memory_of(action: Callable[[], Any]) -> int:
    """Return the most bytes that an action holds at a time."""
    if tracemalloc.is_tracing():
        return 0
    tracemalloc.start()
    try:
        action()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def _check_reading(codec: Codec, frames: Frames, bounds: Bounds | None) -> Correspondences:
    """Return what the codec decodes, having checked that it reads each frame once and leaves it alone."""
    loads: Counter[int] = Counter()
    pictures = [image.copy() for image in frames]

    def load(index: int) -> Image:
        loads[index] += 1
        return pictures[index]

    found: Any = codec.decode(Frames(frames.names, load), bounds)
    twice = [frames.names[i] for i, count in loads.items() if count > 1]
    require(not twice, f"decode() must read each frame at most once; it read {', '.join(twice)} again")
    for name, image, before in zip(frames.names, pictures, frames, strict=True):
        require(np.array_equal(image, before), f"decode() must not change the frames; it changed {name}")
    require(isinstance(found, Correspondences), "decode() must return Correspondences")
    return found


def _check_form(codec: Codec, found: Correspondences, view: View) -> None:
    require(len(found), f"nothing was decoded by {view.name}")
    for name in ("camera_xy", "projector_xy", "sigma", "confidence", "color"):
        require(getattr(found, name).dtype == np.float32, f"{name} must be float32")
    known = np.isfinite(found.projector_xy)
    require((np.isfinite(found.sigma) == known).all(), "sigma must be finite exactly where projector_xy is")
    require((found.sigma[known] > 0).all(), "sigma must be positive")
    require(known.any(axis=1).all(), "a row with no projector coordinate must not be returned")
    good = (found.confidence >= 0) & (found.confidence <= 1)
    require(good.all(), "confidence must lie between 0 and 1")
    require(((found.color >= 0) & (found.color <= 1)).all(), "color must lie between 0 and 1")
    axes = getattr(codec, "axes", None)
    for i, axis in enumerate("xy"):
        if axes in ("x", "y") and axis != axes:
            require(not known[:, i].any(), f"axis {axis} is not coded, so its column must be NaN")
        if axes in (axis, "both"):
            require(known[:, i].any(), f"axis {axis} is coded, but nothing was decoded on it by {view.name}")


def _check_truth(found: Correspondences, view: View, tolerance_px: float) -> None:
    error = np.abs(found.projector_xy - view.truth(found.camera_xy))
    for i, axis in enumerate("xy"):
        known = np.isfinite(error[:, i])
        if not known.any():
            continue
        median = float(np.median(error[known, i]))
        within = float((error[known, i] <= _SIGMAS * found.sigma[known, i]).mean())
        require(median <= tolerance_px, f"{view.name}: the median error on {axis} is {median:.3g} px")
        require(
            within >= _INLIERS, f"{view.name}: only {within:.1%} of {axis} lie within {_SIGMAS:g} sigma of the truth"
        )
    cover, stray = _cover(found, view)
    require(cover >= _LEAST_COVER, f"{view.name}: only {cover:.0%} of what is lit was decoded")
    require(stray <= _STRAY, f"{view.name}: {stray:.1%} of what is not lit was decoded")


def _cover(found: Correspondences, view: View) -> tuple[float, float]:
    """Return the share of lit 8 x 8 px blocks with a row in them, and the rows in the dark per dark pixel."""
    margin = view.margin()
    rows = np.zeros(view.shape)
    col, row = np.rint(found.camera_xy).astype(np.intp).T
    np.add.at(rows, (np.clip(row, 0, view.shape[0] - 1), np.clip(col, 0, view.shape[1] - 1)), 1)
    lit = _blocks(margin).min(axis=(1, 3)) > 0
    dark = margin < -_DARK_PX
    cover = float((_blocks(rows).sum(axis=(1, 3))[lit] > 0).mean())
    return cover, float(rows[dark].sum() / dark.sum()) if dark.any() else 0.0


def _blocks(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    high, wide = (n // _BLOCK_PX for n in values.shape)
    return values[: high * _BLOCK_PX, : wide * _BLOCK_PX].reshape(high, _BLOCK_PX, wide, _BLOCK_PX)


def _check_depths(codec: Codec, frames: Frames, bounds: Bounds | None, found: Correspondences, view: View) -> None:
    """Grey 8-bit pictures, the same in 16 bits, and the same in colour must mean the same."""
    grey = found.as_map(view.shape)
    images = list(frames)
    others = {"16-bit": [image.astype(np.uint16) * 257 for image in images]}
    if images[0].ndim == 2:
        others["colour"] = [np.repeat(image[..., None], 3, axis=2) for image in images]
    for kind, pictures in others.items():
        again = codec.decode(Frames.of(pictures, frames.names), bounds)
        few, many = sorted((len(again), len(found)))
        require(few >= 0.95 * many, f"{kind} frames give {len(again)} rows where 8-bit grey ones give {len(found)}")
        difference = again.as_map(view.shape) - grey
        size = float(np.median(np.abs(difference[np.isfinite(difference)])))
        limit = float(np.nanmedian(found.sigma))
        require(
            size <= limit, f"{kind} frames decode {size:.3g} px away from 8-bit grey ones, at a sigma of {limit:.3g}"
        )


def _check_bounds(codec: Codec, frames: Frames, found: Correspondences, view: View, bounded: bool) -> None:
    kept = codec.decode(frames, view.bounds(4.0))
    require(len(kept) >= 0.98 * len(found), f"true bounds lose rows: {len(kept)} of {len(found)} are left")
    away = view.bounds(4.0, shift_px=float(min(view.projector)) / 2)
    refused = {"bounds that allow no point (NaN)": np.full_like(away, np.nan)}
    if not bounded:  # A codec that needs bounds cannot know better than they do.
        refused["bounds far from the truth"] = away
    for kind, bounds in refused.items():
        try:
            wrong = len(codec.decode(frames, bounds))
        except SlkitError:
            continue
        require(
            wrong <= _OUT_OF_BOUNDS * len(found), f"{kind} must leave nothing, or be an error; {wrong} rows are left"
        )


def _check_refusals(codec: Codec, frames: Frames, bounds: Bounds | None) -> None:
    images, names = list(frames), frames.names
    few = frames.select(range(len(frames) - 1))
    require_refusal(lambda: codec.decode(few, bounds), "decoding one frame too few")
    cut = Frames.of([*images[:-1], images[-1][:-2]], names)
    if len(images) > 1:
        require_refusal(lambda: codec.decode(cut, bounds), "decoding frames of two sizes", mention=names[-1])
    rng = np.random.default_rng(2)
    for kind, level in (("all-black", 0), ("all-white", 255)):
        blank = Frames.of([np.full_like(image, level) for image in images], names)
        require_refusal(lambda blank=blank: codec.decode(blank, bounds), f"decoding {kind} frames")
    noise = Frames.of([np.rint(rng.normal(60, 2, image.shape)).astype(np.uint8) for image in images], names)
    try:
        wrong = len(codec.decode(noise, bounds))
    except SlkitError:
        return
    require(wrong <= _STRAY * images[0].size, f"frames without any pattern, only noise, give {wrong} rows")


def _check_lit(codec: Codec, frames: Frames, view: View) -> None:
    lit = codec.lit(frames)
    require(lit.shape == view.shape, f"lit() must give a picture of shape {view.shape}, not {lit.shape}")
    require(lit.dtype.name in _DEPTHS, f"lit() must give uint8 or uint16, not {lit.dtype}")
    dark = float(np.median(np.min(frames.stack(), axis=0)))
    require(float(np.median(lit)) > dark, "lit() must give the lit scene; it is as dark as the darkest frames")

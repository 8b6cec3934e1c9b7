"""How likely each colour of a projector is where a camera saw a slit."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from slkit.codecs._color_kernels import largest, score, strongest_in_cells

Singles = npt.NDArray[np.float32]

# A channel is not believed to be reflected less than this share as well as the strongest one.
_LEAST_ALBEDO = 0.25
# So many sure slits tell what a colour looks like to this camera.
_LEARNED_FROM, _LEARNED_AT_MOST = 30, 6000
# What makes a slit sure: by so many nats it has one colour rather than any other, with so little noise.
_SURELY, _LEAST_NOISY = 1.0, 0.1
_LESSONS = 2


def local_white(row: npt.NDArray[np.int32], col: Singles, light: Singles, cell: tuple[float, float]) -> Singles:
    """Return what white light would give at each slit (m, 3): the strongest of each channel among the slits around.

    row, col (m,) px; light (m, 3); cell: height and width in px of the neighbourhood. Of a few neighbouring slits some
    show each channel, so that its maximum is what the surface reflects of it. Bounded, for a surface that reflects a
    channel hardly at all cannot be told from one that no light of it reached.
    """
    rows, cols = (row / cell[0]).astype(np.intp), (np.maximum(col, 0) / cell[1]).astype(np.intp)
    shape = (int(rows.max(initial=0)) + 1, int(cols.max(initial=0)) + 3)
    cells = np.zeros((*shape, 3), dtype=np.float32)
    strongest_in_cells(rows, cols + 1, light, cells)
    grown = np.maximum(np.maximum(cells[:, :-2], cells[:, 1:-1]), cells[:, 2:])
    result = grown[rows, cols]
    typical = np.median(result, axis=0) if len(result) else np.ones(3, np.float32)
    typical = np.maximum(typical, 1e-3 * max(float(typical.max()), 1e-6))
    relative = (result / typical).astype(np.float32)
    relative = np.maximum(relative, _LEAST_ALBEDO * largest(relative)[:, None])
    return (np.maximum(relative, 1e-6) * typical).astype(np.float32)


def score_colors(light: Singles, noise: Singles, ideal: Singles, signed: bool) -> Singles:
    """Return how much better each colour explains a slit than "any colour", as log-likelihood ratios (m, k) in nats.

    light (m, 3): white-balanced; noise (m,): its 1 sigma; ideal (k, 3): the colours, strongest channel 1, or with
    `signed` changes of colour. They are learned anew from the slits that are sure, since cameras mix channels.
    Source: the linear mixing model of Caspi, Kiryati and Shamir (1998), a Gaussian about each colour.
    """
    result = np.empty((len(light), len(ideal)), dtype=np.float32)
    strongest = largest(np.abs(light))
    chroma = (light / np.maximum(strongest, 1e-6)[:, None]).astype(np.float32)
    relative = (noise / np.maximum(strongest, np.float32(1e-6))).astype(np.float32)
    # With the strongest channel at 1 colours fill three unit squares, changes of colour six squares of side 2.
    room = 24.0 if signed else 3.0
    step = 1 + len(light) // _LEARNED_AT_MOST
    learned = ideal
    for _ in range(_LESSONS):
        score(chroma, relative, learned, room, result)
        learned = _learned(chroma[::step], result[::step], relative[::step], ideal)
    score(chroma, relative, learned, room, result)
    return result


def _learned(chroma: Singles, scores: Singles, noise: Singles, ideal: Singles) -> Singles:
    """Return what each colour (k, 3) looks like: the median of the slits that no other colour explains nearly as well.

    chroma (m, 3); scores (m, k); noise (m,); ideal (k, 3): what a colour stays where too few slits have it.
    """
    best = scores.argmax(axis=1)
    second, first = np.partition(scores, -2, axis=1)[:, -2:].T
    sure = (first - second > _SURELY) & (noise < _LEAST_NOISY)
    learned = ideal.copy()
    for k in range(len(ideal)):
        own = chroma[sure & (best == k)]
        if len(own) >= _LEARNED_FROM:
            learned[k] = np.median(own, axis=0)
    return learned

"""The paper's two reconstructions of one object, on one planar calibration: a one-shot method beside a dense one.

    python examples/06_compare.py FOLDER

This is what `make compare` runs. Colour stripes need a single picture and give lines, line shift needs many and gives
an area: figures 9 and 10 of the paper, here in simulation, so that the error of either is known, and how much of it the
calibration causes. FOLDER gets comparison.html, the same as JSON and CSV, the clouds, and the simulated pictures.
"""

import sys
from pathlib import Path

import slkit
from slkit import pipeline
from slkit.files import write_toml
from slkit.report.comparison import Comparison
from slkit.simulation import paper_rig

# One projector pixel is half a camera pixel here: lines two pixels wide, eight apart, are what this camera resolves.
LINE_SHIFT = {"codec": "line-shift", "parameters": {"axes": "x", "period": 8, "width": 2}}


def main(folder: Path, truth: slkit.Rig | None = None, poses: int = 10) -> Comparison:
    """Run the comparison into a folder, calibrated from `poses` poses of each side; default rig: the paper's."""
    size = (truth or paper_rig()).projector.size
    write_toml(folder / "line-shift.toml", LINE_SHIFT | {"projector": list(size)})
    codecs = ["color-stripes", str(folder / "line-shift.toml")]
    found = pipeline.compare_simulated(folder, "free-form", codecs, true_rig=truth, poses=poses, seed=1)
    page = pipeline.write_comparison(folder, found, "figures 9 and 10 of the paper, simulated")
    print(f"calibration: {found.calibration}; verdict {found.verdict['grade']}\n")
    print(
        f"{'method':<14} {'patterns':>8} {'points':>7} {'rms mm':>7} {'with the true rig':>18} {'roughness':>10} ",
        end="",
    )
    print(f"{'with the true rig':>18}")
    for method in found.methods:
        n = method.numbers
        print(
            f"{method.name:<14} {n['patterns']:>8.0f} {n['points']:>7.0f} {n['rms_mm']:>7.3f} "
            f"{n['true_rig_rms_mm']:>18.3f} {n['roughness_mm']:>10.3f} {n['true_rig_roughness_mm']:>18.3f}"
        )
    changed = max(abs(m.numbers["roughness_mm"] / m.numbers["true_rig_roughness_mm"] - 1) for m in found.methods)
    print(f"\nThe calibration changes the roughness by {100 * changed:.1f} % at most: what is rough is the method.")
    print(f"page: {page}")
    return found


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python examples/06_compare.py FOLDER")
    main(Path(sys.argv[1]))

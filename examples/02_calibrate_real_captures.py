"""Calibrate from real pictures: a printed chessboard under Gray code, projector below the camera.

    SLKIT_DATA=path/to/data python examples/02_calibrate_real_captures.py [FOLDER]

The pictures are those of `gray_board`, whatever camera program took them: a TOML file says which is which. FOLDER
(default: a temporary one) gets that file and the rig.json.
"""

import os
import sys
import tempfile
from pathlib import Path

import numpy as np

import slkit

TOML = """\
method = "local-homography"
root = {root}
projector = [1024, 768]

[printed]
corners = [9, 7]
square_mm = 75.0

[coded]
poses = "pose*"
codec = "gray"
parameters = {{axes = "both", inverse = true}}
frames = {{x = "*_col_*.png", y = "*_row_*.png", white = "40_*.png", black = "41_*.png"}}
"""


def main(folder: Path) -> None:
    """Calibrate into a folder, or say why that is not possible here."""
    pictures = Path(os.environ.get("SLKIT_DATA", "../shared/data")).absolute() / "gray_board"
    if not pictures.is_dir():
        print(f"there are no captures in {pictures}: set SLKIT_DATA to the folder that holds gray_board")
        return
    folder.mkdir(parents=True, exist_ok=True)
    # A path as a literal string of TOML: backslashes stay what they are.
    (folder / "calibration.toml").write_text(TOML.format(root=f"'{pictures}'"), encoding="utf-8")
    result = slkit.calibrate(folder)
    slkit.write_rig(folder / "rig.json", result.rig, slkit.provenance(result))
    for view in result.views:
        print(f"{view.name}: camera {view.rms_camera:.3f} px, projector {view.rms_projector:.3f} px")
    print(f"all: camera {result.rms_camera:.3f}, projector {result.rms_projector:.3f}, joint {result.rms_joint:.3f} px")
    print(f"verdict: {result.verdict.grade}")
    for finding in result.verdict.reasons:
        print(f"  {finding.fault}; {finding.remedy}")
    center = result.rig.projector_center
    print(f"the projector stands {np.linalg.norm(center):.0f} mm from the camera, at {np.round(center).tolist()} mm")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))

from pathlib import Path

import numpy as np

from slkit.files import read_rig, write_rig
from slkit.simulation import paper_rig


def test_show(slkit, tmp_path: Path):
    rig = paper_rig()
    write_rig(tmp_path / "rig.json", rig, {"method": "planar", "rms_px": {"camera": 0.1, "joint": 0.2}})
    text = slkit("rig", "show", tmp_path / "rig.json").out
    for word in (
        "camera: 768 x 576 px",
        "projector: 1024 x 768 px",
        "focal length 900.00 900.00",
        "rms: camera 0.100 px",
    ):
        assert word in text
    assert "principal point 508.00 830.00" in text
    table = slkit("rig", "show", tmp_path / "rig.json", "--json").json
    assert table["baseline_mm"] == np.linalg.norm(rig.projector_from_camera.translation)
    np.testing.assert_allclose(table["projector_center_mm"], rig.projector_center)
    assert table["rms_px"]["joint"] == 0.2


def test_export_and_import(slkit, tmp_path: Path):
    write_rig(tmp_path / "rig.json", paper_rig())
    assert slkit("rig", "export", tmp_path / "rig.json", "--format", "opencv", "--json").json == {
        "opencv": str(tmp_path / "rig.yml")
    }
    assert slkit("rig", "import", tmp_path / "rig.yml", "--format", "opencv", "-o", tmp_path / "b.json").code == 0
    np.testing.assert_array_equal(read_rig(tmp_path / "b.json").camera.K, paper_rig().camera.K)
    outcome = slkit("rig", "import", tmp_path / "rig.json", "-o", tmp_path / "c.json")
    assert outcome.code == 2 and "rig.json" in outcome.err and not (tmp_path / "c.json").exists()
    assert slkit("rig", "export", tmp_path / "rig.json", "--format", "matlab").code == 2

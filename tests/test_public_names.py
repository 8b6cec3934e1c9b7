import inspect
import subprocess
import sys

import pytest

import slkit
from slkit import pipeline

NAMES = """
BoardView Calibration Capture Correspondences Frames Pinhole PointCloud Pose Rig ScanResult SlkitError calibrate
load_codec patterns projected_checkerboard provenance read_frames read_image read_mesh read_rig scan scan_sequence
simulate_calibration simulate_scan solve_projector triangulate view write_cloud write_rig
""".split()


def test_public_names_are_frozen():
    assert sorted(slkit.__all__) == sorted(NAMES)
    assert set(dir(slkit)) == {*NAMES, "__version__"}


@pytest.mark.parametrize("name", NAMES)
def test_public_name_exists_and_is_documented(name: str):
    assert inspect.getdoc(getattr(slkit, name))


def test_version_and_unknown_name():
    assert slkit.__version__.count(".") >= 1
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = slkit.nothing


def test_names_of_the_pipeline_are_imported_when_they_are_used():
    assert dir(pipeline) == pipeline.__all__ and all(hasattr(pipeline, name) for name in pipeline.__all__)
    with pytest.raises(AttributeError, match=r"'slkit\.pipeline' has no attribute 'nothing'"):
        _ = pipeline.nothing


def test_import_is_light():
    script = "import sys, slkit; print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"

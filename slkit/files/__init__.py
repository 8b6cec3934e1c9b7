"""Pictures, rigs, meshes and capture folders between disk and memory; every write is atomic."""

from slkit.files.atomic import make_folder, parts_of, write_bytes, write_text
from slkit.files.folders import (
    PICTURE_TABLES,
    CalibrationFolder,
    CaptureFolder,
    projector_size,
    read_calibration,
    read_capture,
    toml_file,
)
from slkit.files.images import (
    PICTURE_ENDINGS,
    Progress,
    read_bytes,
    read_frames,
    read_image,
    reading_ahead,
    write_frames,
    write_png,
)
from slkit.files.losses import loss_notes
from slkit.files.meshes import read_mesh
from slkit.files.opencv import read_opencv, write_opencv
from slkit.files.rig import plain, read_provenance, read_rig, rig_table, write_rig
from slkit.files.sequences import PictureSequence, read_sequence
from slkit.files.sources import FrameSource
from slkit.files.tables import merged, read_toml, resolve_root, toml_text, write_toml

__all__ = [
    "PICTURE_ENDINGS",
    "PICTURE_TABLES",
    "CalibrationFolder",
    "CaptureFolder",
    "FrameSource",
    "PictureSequence",
    "Progress",
    "loss_notes",
    "make_folder",
    "merged",
    "parts_of",
    "plain",
    "projector_size",
    "read_bytes",
    "read_calibration",
    "read_capture",
    "read_frames",
    "read_image",
    "read_mesh",
    "read_opencv",
    "read_provenance",
    "read_rig",
    "read_sequence",
    "read_toml",
    "reading_ahead",
    "resolve_root",
    "rig_table",
    "toml_file",
    "toml_text",
    "write_bytes",
    "write_frames",
    "write_opencv",
    "write_png",
    "write_rig",
    "write_text",
    "write_toml",
]

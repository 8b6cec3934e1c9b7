"""Boards, marks and projected patterns: where their points are, and how they look.

One description serves the printer, the simulator and the detector. Board frames have x right, y down, millimetres;
reflectance is a continuous function of the place, so that every picture of a target is filtered, never aliased.
"""

from slkit.targets._dictionaries import dictionary, markers
from slkit.targets._drawing import INK, PAPER, Ink, Printable, Target, grid
from slkit.targets.charuco import Charuco, ProjectedCharuco
from slkit.targets.checkerboard import Checkerboard
from slkit.targets.circles import CircleGrid
from slkit.targets.marks import BorderMarks, CornerMarks
from slkit.targets.projected import ORIGIN_MARK_RADIUS, ProjectedCheckerboard
from slkit.targets.solid import Face, ProjectedFaces, SolidTarget
from slkit.targets.tags import AprilTags, TagMarks

__all__ = [
    "INK",
    "ORIGIN_MARK_RADIUS",
    "PAPER",
    "AprilTags",
    "BorderMarks",
    "Charuco",
    "Checkerboard",
    "CircleGrid",
    "CornerMarks",
    "Face",
    "Ink",
    "Printable",
    "ProjectedCharuco",
    "ProjectedCheckerboard",
    "ProjectedFaces",
    "SolidTarget",
    "TagMarks",
    "Target",
    "dictionary",
    "grid",
    "markers",
]

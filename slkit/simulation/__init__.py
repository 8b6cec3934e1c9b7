"""A camera and a projector without hardware, and the truth about what they see."""

from slkit.simulation.boards import board_poses, boards_for, projected_outline
from slkit.simulation.faults import FAULTS, Fault, views_with_fault, with_fault
from slkit.simulation.rig import (
    in_view,
    one_to_one_rig,
    paper_rig,
    random_rig,
    seen_by,
    working_distance,
    working_volume,
)
from slkit.simulation.scanner import Optics, SimulatedScanner, Truth
from slkit.simulation.scene import (
    SCENES,
    board,
    build,
    dumbbell,
    fitted_mesh,
    free_form,
    from_mesh,
    plane,
    sphere,
    step_wedge,
)
from slkit.simulation.session import CODED, Camera, Session, Shot, coded_session, planar_session
from slkit.simulation.solids import boards_on, facing, folded, solid_poses
from slkit.simulation.surface import Print, Scene, Surface
from slkit.simulation.views import board_views, told_targets

__all__ = [
    "CODED",
    "FAULTS",
    "SCENES",
    "Camera",
    "Fault",
    "Optics",
    "Print",
    "Scene",
    "Session",
    "Shot",
    "SimulatedScanner",
    "Surface",
    "Truth",
    "board",
    "board_poses",
    "board_views",
    "boards_for",
    "boards_on",
    "build",
    "coded_session",
    "dumbbell",
    "facing",
    "fitted_mesh",
    "folded",
    "free_form",
    "from_mesh",
    "in_view",
    "one_to_one_rig",
    "paper_rig",
    "planar_session",
    "plane",
    "projected_outline",
    "random_rig",
    "seen_by",
    "solid_poses",
    "sphere",
    "step_wedge",
    "told_targets",
    "views_with_fault",
    "with_fault",
    "working_distance",
    "working_volume",
]

"""A camera and a projector without hardware, and the truth about what they see."""

from slkit.simulation.boards import board_poses, boards_for, projected_outline
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
from slkit.simulation.surface import Print, Scene, Surface

__all__ = [
    "SCENES",
    "Optics",
    "Print",
    "Scene",
    "SimulatedScanner",
    "Surface",
    "Truth",
    "board",
    "board_poses",
    "boards_for",
    "build",
    "dumbbell",
    "fitted_mesh",
    "free_form",
    "from_mesh",
    "in_view",
    "one_to_one_rig",
    "paper_rig",
    "plane",
    "projected_outline",
    "random_rig",
    "seen_by",
    "sphere",
    "step_wedge",
    "working_distance",
    "working_volume",
]

"""What a view shows, as chosen in the page."""

from dataclasses import dataclass

SURFACES = ("smooth", "mesh of nodes", "none")


@dataclass
class Settings:
    """Written by the page's controls, read by the view's thread.

    Attributes:
        surface: one of SURFACES.
        colour: name of a quantity, or PLAIN_COLOUR.
        ribbons, nodes, names, frames, truth, floor: whether they are shown.
        uncertainty: whether the regions that hold the ribbons with 95 % probability are shown.
        magnify: how many times larger than they are.
        changed: something above was changed since it was last shown.
    """

    surface: str = SURFACES[0]
    colour: str = "curvature"
    ribbons: bool = True
    nodes: bool = True
    names: bool = True
    frames: bool = False
    truth: bool = False
    floor: bool = True
    uncertainty: bool = False
    magnify: float = 1.0
    changed: bool = True

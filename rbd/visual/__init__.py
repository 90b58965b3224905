"""Pictures: the robot with its forces in three dimensions, and a browser that photographs them."""

from rbd.visual.colors import contact_colors
from rbd.visual.contact_sheet import contact_sheet
from rbd.visual.plots import plot_ranges
from rbd.visual.scene import Scene
from rbd.visual.screenshot import find_browser, screenshot

__all__ = ["Scene", "contact_colors", "contact_sheet", "find_browser", "plot_ranges", "screenshot"]

"""Pictures: the robot with its forces in three dimensions, at rest and in motion; curves; screenshots by a headless browser."""

from functools import partial as _partial

from rbd.modules import submodule as _submodule
from rbd.visual.figures.mechanism_plots import plot_trace
from rbd.visual.figures.plan_plots import plot_plan
from rbd.visual.figures.planar_figures import plot_ellipses, plot_sticks
from rbd.visual.figures.planar_plots import plot_panels, plot_paths, plot_split
from rbd.visual.figures.plots import axes_or_new as axes_or_new, plot_ranges
from rbd.visual.figures.statics_plots import plot_capture, plot_directions, plot_pushes, plot_region, plot_wrench_cone
from rbd.visual.figures.study_plots import plot_study
from rbd.visual.figures.trajectory_plots import plot_energy, plot_forces, plot_joint, plot_report, plot_timing
from rbd.visual.figures.walk_plots import plot_control, plot_walk
from rbd.visual.live import Choice, Explorer, Slider, Verdict, explore
from rbd.visual.members_page import export_members as export_members
from rbd.visual.mode_drawing import export_mode, mode_scene, plot_eigenvalues, plot_mode
from rbd.visual.motion_checks_page import export_motion_checks as export_motion_checks
from rbd.visual.notebook.page_frames import notebook_page
from rbd.visual.notebook.shown import html_of as html_of
from rbd.visual.pages.browser import Browser, find_browser
from rbd.visual.pages.page import screenshot
from rbd.visual.playback.animation import export_motion, motion_sheet, replay
from rbd.visual.playback.video import export_video
from rbd.visual.scene import Scene
from rbd.visual.side_by_side import contact_sheet, scenes_beside
from rbd.visual.style import contact_colors
from rbd.visual.terrain_alone import export_terrain as export_terrain, show_terrain as show_terrain

__all__ = [
    "Browser",
    "Choice",
    "Explorer",
    "Scene",
    "Slider",
    "Verdict",
    "contact_colors",
    "contact_sheet",
    "explore",
    "export_mode",
    "export_motion",
    "export_video",
    "find_browser",
    "mode_scene",
    "motion_sheet",
    "notebook_page",
    "plot_capture",
    "plot_control",
    "plot_directions",
    "plot_eigenvalues",
    "plot_ellipses",
    "plot_energy",
    "plot_forces",
    "plot_joint",
    "plot_mode",
    "plot_panels",
    "plot_paths",
    "plot_plan",
    "plot_pushes",
    "plot_ranges",
    "plot_region",
    "plot_split",
    "plot_report",
    "plot_sticks",
    "plot_study",
    "plot_timing",
    "plot_trace",
    "plot_walk",
    "plot_wrench_cone",
    "replay",
    "scenes_beside",
    "screenshot",
]


__getattr__ = _partial(_submodule, __name__)

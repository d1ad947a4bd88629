"""Pictures of what a robot does: a live browser scene, self-contained replay pages, plots and video.

The package imports nothing, because the scene needs meshcat and the plots need matplotlib, and few callers need both.
"""

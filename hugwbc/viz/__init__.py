"""Pictures of what a robot did: a live browser scene, self-contained replay and report pages, plots and video.

Nothing is imported here: the scene brings meshcat and the plots matplotlib, and a caller of one needs not the other.
"""

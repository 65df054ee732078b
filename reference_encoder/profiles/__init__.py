"""The two profiles of the format (SPEC §9): what a scene of each kind is measured by, and how its file is finished.

`profile.py` says what the pipeline asks of a profile; `explicit.py` answers for Gaussians, `anchors.py` for
Scaffold-GS style models.
"""

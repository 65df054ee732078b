"""From a scene to a file (nothing here is normative): measure, decide, quantise, write.

    encode           the entry, and the stages in order
    profiles         what is particular to Gaussian scenes, and to anchor models
    importance       what errors cost, in pictures
    rdo              lattice, classes, rate-distortion curves, layers, allocation
    judge            pictures of what was decided, the quality they have, and rate control
    streaming_block  boxes of tiles, and the opening view
    opening_view     the view that a file opens with, and a small picture of it
    options          what a user can ask for, and what efforts switch on
    tuning           every measured number, with the decision that has it
    out_of_core      scenes larger than memory, range by range
    training         from photos to a file; the networks of its files

One currency runs through all of it: lambda, squared picture error per bit.
"""

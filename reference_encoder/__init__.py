"""From a scene to a file (nothing here is normative): measure, decide, quantise, train networks, write.

    encode      the entry; pipeline: the stages in order, with what each hands on
    profiles    what is particular to Gaussian scenes, and to anchor models
    measure     what errors cost, in pictures
    latent      features through codebooks
    decide      lattice, classes, layers, steps
    judge       pictures of what was decided, and the quality they have
    networks    integer networks, kept where they make the file smaller
    options     what a user can ask for, and what efforts switch on
    tuning      every measured number, with the decision that has it

One currency runs through all of it: lambda, squared picture error per bit. Nothing here imports `reference_decoder`.
"""

"""From a scene to a file (nothing here is normative): measure, decide, quantise, train networks, write.

    encode      the entry; pipeline: the stages in order, with what each hands on
    measure     what errors cost, in pictures
    decide      lattice, classes, layers, steps
    latent      features through codebooks
    networks    integer networks, kept where they make the file smaller

One currency runs through all of it: lambda, squared picture error per bit. Nothing here imports `reference_decoder`.
"""

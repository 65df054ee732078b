"""The decoder in C (``scar.h``): models and tiles of files, and the inner loops of the encoder that are worth it.

    library  the compiled library, found and loaded, and its functions
    file     the models and tiles of one file; what the library refuses, :mod:`scarfmt.coding` reads again and explains

It gives the numbers that :mod:`scarfmt.coding` defines, and is optional: without it everything is the same, and slower.
"""

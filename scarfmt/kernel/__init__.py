"""The second engine: inner loops in C, called through ctypes (docs/decisions/0016).

The library is built when the package is installed and a C compiler is found. With it
:class:`scarfmt.kernel.engine.KernelEngine` does what :class:`scarfmt.coding.engine.NumpyEngine` defines, to the same
integers and bytes, and leaves the rest to that. Other threads run while the library does. Nothing below this package
imports it; :mod:`scarfmt.engines` chooses.
"""

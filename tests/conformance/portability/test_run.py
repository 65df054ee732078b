"""The questions of the portability run; the emulation itself is run by hand."""

from __future__ import annotations

from scarfmt_conformance.manifest import find_suite, load_suite

from conformance.portability.machines import MACHINES, System
from conformance.portability.run import FOLDER, chosen


def test_all_vectors_but_those_of_limits_are_asked_about_the_smallest_first() -> None:
    """Limits take hours under emulation."""
    suite = load_suite(find_suite(None))
    vectors = chosen(suite, [])
    left = {vector.id for vector in suite.vectors} - {vector.id for vector in vectors}
    assert all("/limit-" in id_ or "/work-" in id_ for id_ in left)
    assert len(vectors) > 700
    assert [vector.bytes for vector in vectors] == sorted(vector.bytes for vector in vectors)


def test_a_big_endian_machine_is_among_them_and_code_comes_from_its_copy() -> None:
    """Without PYTHONSAFEPATH the checkout's own modules, and its x86 library, would be imported."""
    assert {machine.byteorder for machine in MACHINES} == {"little", "big"}
    words = System(MACHINES[0], FOLDER / "s390x", native=False).command("-m", "module")
    assert words[-2:] == ["-m", "module"]
    assert {"PYTHONSAFEPATH=1", "SCARFMT_NATIVE=0", f"PYTHONPATH={FOLDER / 's390x' / 'code'}"} <= set(words)

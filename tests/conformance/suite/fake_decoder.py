"""A decoder that does what the file it is asked about says: JSON, with an answer and a way to misbehave.

Run as a script, by the runner under test, in both ways of the protocol. Only the standard library: it starts fast.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

STAGES = ["container", "models", "indices", "values", "activated", "metadata"]
CAPABILITIES = {
    "protocol": "scar-conformance 2",
    "decoder": "fake 1",
    "versions": ["0.1"],
    "profiles": ["explicit", "anchor"],
    "stages": STAGES,
}


def child_that_holds_the_output(told: str) -> None:
    """Start a process that outlives this one with its standard output open; its number goes into the file `told`."""
    number = os.fork()
    if number == 0:
        time.sleep(300)
        os._exit(0)
    Path(told).write_text(str(number))


def misbehave(plan: dict[str, Any], answer: str) -> bool:
    """Do what the plan says beside, or instead of, answering; whether the answer is still to be printed."""
    what = plan.get("misbehave")
    if what == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    elif what == "exit":
        sys.stdout.write(answer + "\n")
        sys.stdout.flush()
        os._exit(3)
    elif what == "hang":
        child_that_holds_the_output(plan["told"])
        time.sleep(300)
    elif what == "leave a child":
        child_that_holds_the_output(plan["told"])
    elif what == "allocate":
        bytearray(4 << 30)
    elif what == "print":
        sys.stdout.buffer.write(plan["text"].encode("latin-1"))
        return False
    elif what == "complain":
        for _ in range(400):
            sys.stderr.write("\x1b[31mbad\x00 " * 1000 + "\n")
        sys.stderr.write("the last words\n")
    return True


def reply(file: str, layers: int, stage: str) -> None:
    if stage == "capabilities":
        claims = {**CAPABILITIES, **json.loads(os.environ.get("FAKE_CLAIMS", "{}"))}
        print(json.dumps({"capabilities": claims}), flush=True)
        return
    data = Path(file).read_bytes()
    plan = json.loads(data.rstrip(b"\0"))
    found = plan["answers"].get(f"{stage} {layers}", {"refused": "unasked"})
    if found == "size":
        found = {"refused": "size-" + str(len(data))}
    answer = json.dumps(found)
    if misbehave(plan, answer):
        print(answer)
    sys.stdout.flush()


def main() -> None:
    if sys.argv[1:] == ["--session"]:
        for line in sys.stdin:
            asked = json.loads(line)
            reply(asked["file"], asked["layers"], asked["stage"])
    else:
        reply(sys.argv[1], int(sys.argv[2]), sys.argv[3])


if __name__ == "__main__":
    main()

"""How failures end the command: one line on stderr, and an exit code.

0: done. 1: the input is invalid, or the work failed. 2: the arguments are wrong, the output name included.
75: left off as asked, the same command goes on (sysexits.h calls it a temporary failure).
130: interrupted (143 when terminated, 129 when the terminal hangs up). Nothing half-written stays behind in any case.
"""

from __future__ import annotations

import errno
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any, NoReturn, ParamSpec, TypeVar

import click

from scarfmt.errors import InputWarning, ScarError, missing_package

FAILED = 1
WRONG_ARGUMENTS = 2
UNFINISHED = 75
INTERRUPTED = 130

ARGUMENT_REFUSALS = frozenset(
    {
        "input-attributes",
        "input-box",
        "input-cluster",
        "input-frame",
        "input-layers",
        "input-options",
        "input-parts",
        "input-stream",
        "input-suite",
        "input-tiles",
        "output-exists",
        "output-format",
        "output-path",
        "output-stream",
        "work-exists",
        "work-plan",
    }
)
"""Refusals about what the user typed, not about what a file holds."""

P = ParamSpec("P")
T = TypeVar("T")


def requires_extra(extra: str, torch: str = "neural") -> Callable[[Callable[P, T]], Callable[P, T]]:
    """A decorator that turns a missing package into an error which names the pip extra to install.

    Args:
        extra: the extra of the command.
        torch: the extra that brings torch. It differs from `extra` where most of the command works without torch.
    """

    def decorate(command: Callable[P, T]) -> Callable[P, T]:
        @wraps(command)
        def run(*args: P.args, **kwargs: P.kwargs) -> T:
            try:
                return command(*args, **kwargs)
            except ModuleNotFoundError as error:
                package = (error.name or "").partition(".")[0]
                if package in ("scarfmt", "reference_encoder", "reference_decoder", ""):
                    raise
                raise missing_package(package, torch if package == "torch" else extra) from error

        return run

    return decorate


@contextmanager
def warnings_on_stderr(quiet: bool = False) -> Iterator[None]:
    """While active, each :class:`InputWarning` is printed as a line on stderr, or not at all if `quiet`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if quiet else "always", InputWarning)
        others = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            if issubclass(category, InputWarning):
                click.echo(f"scarfmt: warning: {message}", err=True)
            else:
                others(message, category, *place, **more)

        warnings.showwarning = show
        yield


class FailureGroup(click.Group):
    """A command group whose subcommands fail without a traceback when the fault is the user's."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except ScarError as error:
            _fail(ctx, str(error), WRONG_ARGUMENTS if error.refusal in ARGUMENT_REFUSALS else FAILED)
        except KeyboardInterrupt:
            click.echo("scarfmt: interrupted", err=True)
            ctx.exit(INTERRUPTED)
        except MemoryError:
            _fail(ctx, "out-of-memory: this machine has too little memory for the scene", FAILED)
        except OSError as error:
            if error.errno == errno.EPIPE:
                raise  # click ends quietly when the reader of a pipe has gone
            _fail(ctx, f"os-error: {error}", FAILED)


def _fail(ctx: click.Context, message: str, code: int) -> NoReturn:
    click.echo(f"scarfmt: error: {message}", err=True)
    ctx.exit(code)

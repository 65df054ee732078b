"""How failures end the command: one line on stderr, and an exit code.

0: done. 1: the input is invalid, or the work failed. 2: the arguments are wrong, the output name included.
75: left off as asked, the same command goes on (sysexits.h calls it a temporary failure).
130: interrupted (143 when terminated, 129 when the terminal hangs up). Nothing half-written stays behind in any case.
"""

from __future__ import annotations

import errno
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import wraps
from types import MappingProxyType
from typing import Any, NoReturn, ParamSpec, TypeVar

import click

from scarfmt.atomic import FULL, keep_files_apart
from scarfmt.errors import MAX_MESSAGE, InputWarning, LossWarning, ScarError, missing_package, printable

FAILED = 1
WRONG_ARGUMENTS = 2
UNFINISHED = 75
INTERRUPTED = 130

ARGUMENT_REFUSALS = frozenset(
    {
        "input-attributes",
        "input-bake",
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

_HINTS = {
    "input-folder": "encode FOLDER/* --out-dir OUT encodes each scene in it, encode --work DIR all of them as one",
    "input-bake": "decode to .npz, or use --bake",
    "output-exists": "choose another name, or use --force to overwrite it",
    "truncated-file": "decode --allow-truncated reads the layers that are complete",
}
"""What to do about a refusal, in options of the command line: the library's messages name none."""

P = ParamSpec("P")
T = TypeVar("T")


def requires_extra(extra: str, torch: str = "train") -> Callable[[Callable[P, T]], Callable[P, T]]:
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
    """While active, each :class:`InputWarning` is printed as a line on stderr; of those, if `quiet`, only a
    :class:`~scarfmt.errors.LossWarning`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if quiet else "always", InputWarning)
        warnings.simplefilter("always", LossWarning)
        others = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            if issubclass(category, InputWarning):
                click.echo(f"scarfmt: warning: {printable(str(message))}", err=True)
            else:
                others(message, category, *place, **more)

        warnings.showwarning = show
        yield


class FailureGroup(click.Group):
    """A command group whose subcommands fail without a traceback when the fault is the user's."""

    def make_context(self, *args: Any, **extra: Any) -> click.Context:
        try:
            return super().make_context(*args, **extra)
        except click.UsageError as error:
            _fail(error)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        # People type `help COMMAND`.
        return super().parse_args(ctx, [*args[1:], "--help"] if args[:1] == ["help"] else args)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            with keep_files_apart(), warnings_on_stderr():
                return super().invoke(ctx)
        except KeyboardInterrupt:
            click.echo("scarfmt: interrupted", err=True)
            ctx.exit(INTERRUPTED)
        except OSError as error:
            if error.errno == errno.EPIPE:
                raise  # click ends quietly when the reader of a pipe has gone
            _fail(error, self._options(ctx))
        except (ScarError, click.UsageError, MemoryError) as error:
            _fail(error, self._options(ctx))

    def _options(self, ctx: click.Context) -> dict[str | None, str]:
        """Options of the command that runs, by the parameters that the library's errors name."""
        command = self.get_command(ctx, ctx.invoked_subcommand or "")
        found = [] if command is None else command.params
        return {one.name: one.opts[0] for one in found if isinstance(one, click.Option)}


def _fail(error: Failure, options: Mapping[str | None, str] = MappingProxyType({})) -> NoReturn:
    if isinstance(error, click.UsageError) and error.ctx is not None and error.message == error.ctx.get_help():
        raise error  # a command without arguments: click prints its help
    click.echo(f"scarfmt: error: {printable(describe(error, options), 2 * MAX_MESSAGE)}", err=True)
    wrong = isinstance(error, click.UsageError) or getattr(error, "refusal", None) in ARGUMENT_REFUSALS
    raise click.exceptions.Exit(WRONG_ARGUMENTS if wrong else FAILED)


Failure = ScarError | click.UsageError | MemoryError | OSError


def describe(error: Failure, options: Mapping[str | None, str] = MappingProxyType({})) -> str:
    """A failure as one line for people: its id, what is wrong, and what to do.

    Args:
        options: names of options by the parameters they set, to be named in place of these.
    """
    if isinstance(error, ScarError):
        hint = f"; {_HINTS[error.refusal]}" if error.refusal in _HINTS else ""
        field = options.get(error.field, error.field)
        return f"{ScarError(error.refusal, error.message, offset=error.offset, field=field)}{hint}"
    if isinstance(error, click.UsageError):
        command = "scarfmt" if error.ctx is None else error.ctx.command_path
        return f"input-usage: {error.format_message().rstrip('.')}; see {command} --help"
    if isinstance(error, MemoryError):
        return "out-of-memory: this machine has too little memory for the scene"
    return f"{'os-full' if error.errno in FULL else 'os-error'}: {error}"

"""`scarfmt validate`: lists every rule that a file breaks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from scarfmt.cli.failures import FAILED
from scarfmt.cli.files import open_input, timeout_option
from scarfmt.cli.progress import progress
from scarfmt.cli.report import Report, reports
from scarfmt.errors import plural

if TYPE_CHECKING:
    from scarfmt.tools.validate import Finding, Validation


@click.command()
@click.argument("file")
@click.option("--layers", type=click.IntRange(min=1), help="Check only the first layers, this many.")
@click.option("--no-limits", is_flag=True, help="Do not limit memory and work; for files you trust.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing: the exit code is the answer.")
@timeout_option
@reports
def validate(file: str, layers: int | None, no_limits: bool, quiet: bool) -> Report:
    """Check FILE (a path, a URL or -) against every rule of the specification.

    The command decodes all tiles, and lists each fault in one line: 'error: ID @ OFFSET: MESSAGE'. The last line gives
    the number of layers, from the first, that decode in every tile. The exit code is 0 if there is no error, else 1.
    Warnings are not errors.

    \b
    Examples:
      scarfmt validate scene.scar
      scarfmt validate scene.scar --json | jq -r '.findings[].refusal'
    """
    from scarfmt.limits import DEFAULT_LIMITS, FORMAT_LIMITS
    from scarfmt.tools import validate as validation

    limits = FORMAT_LIMITS if no_limits else DEFAULT_LIMITS
    with open_input(file) as source, progress(quiet) as report:
        result = validation.validate(source, layers=layers, limits=limits, report=report)
    lines = [*map(_line, result.findings), _verdict(file, result)]
    return Report({"file": file, **result.as_json()}, "\n".join(lines), code=0 if result.valid else FAILED)


def _verdict(file: str, result: Validation) -> str:
    verdict = "valid" if result.valid else "not valid"
    layers = f"{result.layers_readable} of {plural(result.layers_declared, 'layer')} readable"
    if result.layers_checked < result.layers_available:
        layers += f", {result.layers_checked} checked"
    work = f"{plural(result.blocks_checked, 'block')} and {plural(result.tiles_decoded, 'tile')} sound"
    return f"{file}: {verdict}; {layers}, {work}"


def _line(finding: Finding) -> str:
    place = "?" if finding.offset is None else str(finding.offset)
    subject = "" if finding.field is None else f" ({finding.field})"
    return f"{finding.severity}: {finding.refusal} @ {place}: {finding.message}{subject}"

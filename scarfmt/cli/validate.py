"""`scarfmt validate`: lists every rule that a file breaks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from scarfmt.cli.failures import FAILED
from scarfmt.cli.files import open_input, opens_index, print_json, timeout_option
from scarfmt.cli.progress import progress

if TYPE_CHECKING:
    from reference_decoder.scenes.checking import SceneValidation
    from scarfmt.coding.writer import Report
    from scarfmt.container.source import ByteSource
    from scarfmt.limits import Limits
    from scarfmt.tools.validate import Finding, Validation


@click.command(short_help="List every rule a file breaks.")
@click.argument("file")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object on stdout.")
@click.option("--layers", type=click.IntRange(min=1), help="Check only the first layers, this many.")
@click.option("--no-limits", is_flag=True, help="Do not limit memory and work; for files you trust.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing: the exit code is the answer.")
@timeout_option
@click.pass_context
def validate(ctx: click.Context, file: str, as_json: bool, layers: int | None, no_limits: bool, quiet: bool) -> None:
    """Check FILE (a path, a URL or -) against every rule of the specification.

    FILE may be a scene index. The command then checks all of its files, that each is the one listed, and that each
    lies in its box.

    The command decodes all tiles. It continues after a fault where it can, and lists each fault in one line: 'error:
    ID @ OFFSET: MESSAGE'. The last line gives the number of layers, from the first, that decode in every tile. The exit
    code is 0 if there is no error, else 1. Warnings are not errors.

    \b
    Examples:
      scarfmt validate scene.scar
      scarfmt validate scene.scar --json | jq -r '.findings[].refusal'
    """
    from scarfmt.limits import DEFAULT_LIMITS, FORMAT_LIMITS
    from scarfmt.tools import validate as validation

    limits = FORMAT_LIMITS if no_limits else DEFAULT_LIMITS
    with open_input(file) as source, progress(quiet or as_json) as report:
        if opens_index(source):
            found = _checked_index(file, source, limits, layers, report)
            _report_index(file, found, as_json, quiet)
            ctx.exit(0 if found.valid else FAILED)
        result = validation.validate(source, layers=layers, limits=limits, report=report)
    if as_json:
        print_json({"file": file, **result.as_json()})
    elif not quiet:
        _print(file, result)
    if not result.valid:
        ctx.exit(FAILED)


def _print(file: str, result: Validation) -> None:
    for finding in result.findings:
        click.echo(_line(finding), err=True)
    verdict = "valid" if result.valid else "not valid"
    layers = f"{result.layers_readable} of {result.layers_declared} layers readable"
    if result.layers_checked < result.layers_available:
        layers += f", {result.layers_checked} checked"
    work = f"{result.blocks_checked:,} blocks and {result.tiles_decoded:,} tiles sound"
    click.echo(f"{file}: {verdict}; {layers}, {work}", err=True)


def _line(finding: Finding) -> str:
    place = "?" if finding.offset is None else str(finding.offset)
    subject = "" if finding.field is None else f" ({finding.field})"
    return f"{finding.severity}: {finding.refusal} @ {place}: {finding.message}{subject}"


def _checked_index(
    file: str, source: ByteSource, limits: Limits, layers: int | None, report: Report
) -> SceneValidation:
    """Findings about an index and its files. If the index is refused, the refusal is the only finding."""
    from reference_decoder.scenes.checking import SceneValidation, validate_scene
    from reference_decoder.scenes.scene_set import open_scene
    from scarfmt.errors import InvalidInput, ScarError
    from scarfmt.tools.validate import Finding

    try:
        scene = open_scene(file, source=source, opener=open_input, limits=limits)
    except InvalidInput:
        raise
    except ScarError as error:
        return SceneValidation(findings=[Finding(error.refusal, error.message, error.offset, error.field)])
    with scene:
        return validate_scene(scene, layers=layers, report=report)


def _report_index(file: str, found: SceneValidation, as_json: bool, quiet: bool) -> None:
    if as_json:
        print_json({"file": file, **found.as_json()})
        return
    if quiet:
        return
    for finding in found.findings:
        click.echo(_line(finding), err=True)
    for uri, result in found.files.items():
        _print(f"{file}: {uri}", result)
    click.echo(f"{file}: {'valid' if found.valid else 'not valid'}; {len(found.files):,} files read", err=True)

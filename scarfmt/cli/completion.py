"""`scarfmt completion`: the script that teaches a shell to complete commands and options."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def completion(ctx: click.Context, shell: str) -> None:
    """Print the completion script of a SHELL.

    \b
    Examples:
      scarfmt completion bash > ~/.local/share/bash-completion/completions/scarfmt
      scarfmt completion zsh > ~/.zfunc/_scarfmt
      scarfmt completion fish > ~/.config/fish/completions/scarfmt.fish
    """
    script = get_completion_class(shell)
    if script is None:
        raise click.UsageError(f"this version of click has no completion for {shell}")
    click.echo(script(ctx.find_root().command, {}, "scarfmt", "_SCARFMT_COMPLETE").source())

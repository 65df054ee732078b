"""`scarfmt view`: the viewer page, served to a browser on this machine."""

from __future__ import annotations

import click

from scarfmt.cli.files import open_input, timeout_option

_MOST_SCENES = 2


@click.command()
@click.argument("scenes", metavar="[FILE [OTHER]]", nargs=-1)
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port of the server [default: a free one].")
@click.option(
    "--host", default="127.0.0.1", metavar="ADDRESS", show_default=True,
    help="Address to listen on. 0.0.0.0 lets everyone on the network read the scenes.",
)  # fmt: skip
@click.option("--no-browser", is_flag=True, help="Only serve: print the address, open nothing.")
@timeout_option
def view(scenes: tuple[str, ...], port: int, host: str, no_browser: bool) -> None:
    """Show FILE (a path or URL) in a browser, and refine it while bytes arrive. OTHER is shown beside it.

    A server on this machine sends the page until Ctrl-C. It contacts nothing but the servers of the URLs given.
    Without FILE, the page waits for a file to be dropped on it.

    \b
    Examples:
      scarfmt view scene.scar
      scarfmt view scene.scar smaller.scar
      scarfmt view https://example.org/scene.scar
      scarfmt view scene.scar --no-browser --port 8080
    """
    from scarfmt.tools.inspection import inspect
    from scarfmt.viewer.offers import page_offers, scene_offer
    from scarfmt.viewer.server import ViewerServer, page_address, serve

    if len(scenes) > _MOST_SCENES:
        raise click.UsageError(f"at most {_MOST_SCENES} scenes can be seen side by side, {len(scenes)} were given")
    offers, paths = {}, []
    for number, origin in enumerate(scenes):
        source = open_input(origin)
        # Says at once what else the page would say: that a file is missing, or is no .scar file.
        inspect(source)
        path, offer = scene_offer(origin, number, source)
        offers[path] = offer
        paths.append(path)
    try:
        server = ViewerServer(page_offers() | offers, host, port)
    except OSError as error:
        raise OSError(f"cannot listen on {host}, port {port}: {error.strerror or error}") from error
    address = page_address(server.url, paths)
    click.echo(f"{address}  (Ctrl-C ends)", err=True)
    if not no_browser:
        click.launch(address)
    serve(server)

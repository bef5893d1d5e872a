"""Commands about the world itself: which scenarios there are."""


def scenarios() -> None:
    """List the scenarios: what each one is, and the numbers that its design follows from."""
    from rich.console import Console
    from rich.table import Table

    from lissajous_env import library

    table = Table(title="Scenarios", title_justify="left", box=None, header_style="bold", padding=(0, 2, 0, 0))
    table.add_column("name", style="bold cyan", no_wrap=True)
    table.add_column("N", justify="right")
    table.add_column("robots")
    table.add_column("rectangle\n[m]", no_wrap=True)
    table.add_column("curve\na:b", justify="right")
    table.add_column("r_s\n[m]", justify="right")
    table.add_column("T_max\n[s]", justify="right")
    table.add_column("description")
    for name in library.scenarios():
        each = library.scenario(name).resolve()
        curve = each.curve
        sides = [2 * curve.half_width, 2 * curve.half_height, 2 * curve.half_depth]
        table.add_row(
            name,
            str(each.num_robots),
            each.robot.kind,
            " x ".join(f"{side:g}" for side in sides if side > 0),
            f"{curve.a}:{curve.b}" + (f":{curve.c}" if curve.half_depth > 0 else ""),
            f"{each.sensing.radius:.3g}",
            f"{each.detection_time_bound:.3g}",
            each.description,
        )
    console = Console()
    console.print(table)
    console.print(
        "\n[dim]N robots; r_s: sensing radius; T_max = (2 pi / omega) / (N / kappa), bound on detection.[/dim]"
    )

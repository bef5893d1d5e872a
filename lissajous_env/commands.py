"""Commands about the world itself: which scenarios there are."""


def scenarios() -> None:
    """List the scenarios, with the numbers that describe their designs."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from lissajous_env import library

    console = Console()
    narrow = console.width < 110
    table = Table(box=None, header_style="bold", padding=(0, 2, 0, 0), pad_edge=False)
    table.add_column("name", style="bold cyan", no_wrap=True)
    for title in ("N", "robots", "rectangle\n\\[m]", "curve\na:b", "r_s\n\\[m]", "T_max\n\\[s]"):
        table.add_column(title, justify="left" if title == "robots" else "right", no_wrap=True)
    if not narrow:
        table.add_column("description")
    made = [library.scenario(name).resolve() for name in library.scenarios()]
    for each in made:
        curve = each.curve
        sides = [2 * curve.half_width, 2 * curve.half_height, 2 * curve.half_depth]
        table.add_row(
            each.name,
            str(each.num_robots),
            each.robot.kind,
            " x ".join(f"{side:g}" for side in sides if side > 0),
            f"{curve.a}:{curve.b}" + (f":{curve.c}" if curve.half_depth > 0 else ""),
            f"{each.sensing.radius:.3g}",
            f"{each.detection_time_bound:.3g}",
            *([] if narrow else [escape(each.description)]),
        )
    console.print(table, "")
    if narrow:
        for each in made:
            console.print(f"[bold cyan]{each.name}[/]: {escape(each.description)}", highlight=False)
        console.print()
    words = "N robots; r_s sensing radius; T_max = (2 pi / omega) / (N / kappa), by which a target is detected."
    console.print(words, style="dim", highlight=False)

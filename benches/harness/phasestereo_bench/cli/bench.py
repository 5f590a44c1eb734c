"""``phasestereo bench`` runs benchmarks; each kind of command has a module."""

from collections.abc import Callable

from cyclopts import App, Parameter

from phasestereo_bench.cli import (
    bench_all,
    bench_choices,
    bench_direct,
    bench_files,
    bench_middlebury,
    bench_speed,
    bench_suites,
)

app = App(
    name="bench",
    help_format="markdown",
    default_parameter=Parameter(negative_iterable=()),
)
_COMMANDS: dict[str, Callable[..., None]] = {
    "paper": bench_files.paper,
    "middlebury": bench_middlebury.middlebury,
    "blur": bench_suites.blur,
    "choices": bench_choices.choices,
    "compare": bench_files.compare,
    "confidence": bench_suites.confidence,
    "range": bench_direct.range_,
    "recordings": bench_suites.recordings,
    "speed": bench_speed.speed,
    "submit": bench_files.submit,
    "surfaces": bench_suites.surfaces,
    "video": bench_direct.video,
    "verify": bench_direct.verify,
    "report": bench_middlebury.report,
    "tables": bench_all.tables,
}
for _name, _command in _COMMANDS.items():
    app.command(_command, name=_name)

"""``phasestereo bench``: benchmarks, one module a command."""

from __future__ import annotations

from collections.abc import Callable

from cyclopts import App, Parameter

from phasestereo_bench.cli import (
    bench_all,
    bench_blur,
    bench_choices,
    bench_compare,
    bench_confidence,
    bench_middlebury,
    bench_paper,
    bench_range,
    bench_recordings,
    bench_report,
    bench_speed,
    bench_submit,
    bench_surfaces,
    bench_verify,
    bench_video,
)

app = App(
    name="bench",
    help_format="markdown",
    default_parameter=Parameter(negative_iterable=()),
)
_COMMANDS: dict[str, Callable[..., None]] = {
    "paper": bench_paper.paper,
    "middlebury": bench_middlebury.middlebury,
    "blur": bench_blur.blur,
    "choices": bench_choices.choices,
    "compare": bench_compare.compare,
    "confidence": bench_confidence.confidence,
    "range": bench_range.range_,
    "recordings": bench_recordings.recordings,
    "speed": bench_speed.speed,
    "submit": bench_submit.submit,
    "surfaces": bench_surfaces.surfaces,
    "video": bench_video.video,
    "verify": bench_verify.verify,
    "report": bench_report.report,
    "tables": bench_all.tables,
}
for _name, _command in _COMMANDS.items():
    app.command(_command, name=_name)

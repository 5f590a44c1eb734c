"""``phasestereo bench``: benchmarks, one module a command."""

from __future__ import annotations

from cyclopts import App, Parameter

from phasestereo_bench.cli import (
    bench_all,
    bench_blur,
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
app.command(bench_paper.paper)
app.command(bench_middlebury.middlebury)
app.command(bench_blur.blur)
app.command(bench_compare.compare)
app.command(bench_confidence.confidence)
app.command(bench_range.range_, name="range")
app.command(bench_recordings.recordings)
app.command(bench_speed.speed)
app.command(bench_submit.submit)
app.command(bench_surfaces.surfaces)
app.command(bench_video.video)
app.command(bench_verify.verify)
app.command(bench_report.report)
app.command(bench_all.tables)

"""Every table by one command; and the documentation shows the numbers of its file of results."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import json
import re
from collections.abc import Callable
from pathlib import Path
from statistics import fmean
from typing import Any

import pytest
from test_bench_cases import plant

from phasestereo_bench import methods
from phasestereo_bench.report.documents import MARKERS
from phasestereo_bench.report.tables import MISSING
from phasestereo_bench.rigs import FAULTS, RIGS
from phasestereo_bench.tables import comparison, export
from phasestereo_bench.tables.headline import COLUMNS, TITLES
from phasestereo_bench.tables.ours import CHOICES, choice_table
from phasestereo_bench.tables.plan import job_groups
from support import ROOT, counterpart

Run = Callable[..., tuple[int, str, str]]

counterpart("cv2")

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def results() -> dict[str, Any]:
    """Return the numbers that are committed."""
    found: dict[str, Any] = json.loads((ROOT / "docs/results.json").read_text("utf-8"))
    return found


def table(marker: str) -> list[list[str]]:
    """Return the rows of a table of the documentation, without emphasis."""
    texts = (page.read_text("utf-8") for page in PAGES)
    place = f"<!-- bench:{marker} -->"
    text = next(text for text in texts if place in text).partition(place)[2]
    text = text.partition("<!-- /bench")[0].replace("*", "").replace("\\", "")
    lines = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("|")]
    return [lines[0], *lines[2:]]


# The command


def test_one_command_makes_all_tables_and_the_same_again(tmp_path: Path, run: Run) -> None:
    root = tmp_path / "data"
    plant(root / "middlebury", "tsukuba")
    command = ["bench", "tables", root, "--quick", "--workers", 1, "--speed-rounds", 0]

    code, _, err = run(*command, "-o", tmp_path / "one")
    assert code == 0, err

    content = json.loads((tmp_path / "one/results.json").read_text("utf-8"))
    assert set(content["suites"]) == {"one-sided-blur", "rigs", "rigs-2", "sharp"}
    assert set(content["suites"]["rigs"]["bad_1"]) == set(FAULTS)
    assert set(content["headline"]) == set(COLUMNS)
    assert {"fast", "opencv:sgbm"} <= set(content["headline"]["webcam"])
    assert {record["method"] for record in content["costs"]} >= {"fast", "opencv:sgbm-3way"}

    first = (tmp_path / "one/results.json").read_bytes()
    code, _, err = run(*command, "-o", tmp_path / "one")  # all of it is there already
    assert code == 0, err
    assert (err.count("are in"), (tmp_path / "one/results.json").read_bytes()) == (8, first)

    export(tmp_path / "nothing", tmp_path / "one/results.json")  # keeps what it has no records of
    assert (tmp_path / "one/results.json").read_bytes() == first

    code, _, err = run("bench", "compare", tmp_path / "one/results.json", "-o", tmp_path)
    assert code == 0, err
    assert "robust, nothing given" in (tmp_path / "compare-faults.svg").read_text("utf-8")

    code, out, err = run("bench", "report", tmp_path / "one/rigs.jsonl")
    assert code == 0, err
    assert re.search(r"^degradation +fast +robust", out, re.MULTILINE)  # 44 would not fit across
    assert re.search(r"^two phones +\d", out, re.MULTILINE)


def test_a_plan_has_all_that_there_is(data: Path) -> None:
    there = {stage.name: stage for stage in job_groups(data, [])}
    assert list(there) == [
        "one-sided-blur",
        "sharp",
        "rigs",
        "rigs-2",
        "choices",
        "synthesis",
        "rendered",
        "surfaces",
        "blur",
        "real",
        "costs",
    ]

    assert {job.key["degradation"] for job in there["rigs"].jobs} == set(FAULTS)
    kinds = {job.key["kind"] for job in there["real"].jobs}
    assert kinds == {"recording-rows", "recording-frame", "real-pair"}

    assert [stage.name for stage in there.values() if stage.alone] == ["costs"]

    counterpart("onnxruntime")
    network = f"hitnet:{data / 'rivals/hitnet_eth3d.onnx'}"
    also = {"prepared:hitnet", "fused:hitnet"}
    for stage in job_groups(data, [network]):
        ran = {job.key.get("method") for job in stage.jobs}
        assert (also <= ran) == (stage.name in ("one-sided-blur", "sharp", "rigs", "costs"))


def test_choices_are_legal_and_have_a_mean_of_each_kind_of_pairs() -> None:
    assert all(methods.method(spec) for spec in CHOICES)

    record = {"method": "robust", "degradation": "noise 5", "v3": {"bad_2": 0.0}}
    records = [
        record | {"status": "ok", "v2": {"nonocc": 3.0}},
        record | {"status": "ok", "v2": {"nonocc": 4.0}},
        record | {"status": "failed"},
    ]
    header, first = choice_table(records).header, choice_table(records).rows[0]
    row = dict(zip(header, [entry.text for entry in first], strict=True))
    assert (row["settings"], row["noise 5"], row["sharp"]) == ("robust", "3.50", MISSING)


# The documentation


def test_the_first_table_is_that_of_the_results() -> None:
    message, (header, *rows) = results(), table("headline")
    assert header[1:-2] == list(COLUMNS)

    by_title = {title: method for method, title in TITLES.items()}
    ran = message["headline"]["sharp"]
    assert [by_title[row[0]] for row in rows] == [method for method in TITLES if method in ran]

    for row in rows:
        values = [message["headline"][column][by_title[row[0]]] for column in COLUMNS]
        assert row[1:-2] == [f"{value:.1f}" for value in values]

    for column, (suite, names) in COLUMNS.items():
        for name in names:
            for method, value in message["headline"][column].items():
                shown = fmean(message["suites"][suite]["bad_1"][name][method])
                assert value == pytest.approx(shown, abs=2e-3)


def test_the_comparison_is_that_of_the_results(tmp_path: Path) -> None:
    numbers = comparison.read_numbers(ROOT / "docs/results.json")
    assert comparison.comparison_text(numbers) in (ROOT / "docs/compare.md").read_text("utf-8")

    drawn = {path.name for path in comparison.draw_comparison(numbers, tmp_path)}
    assert drawn == {path.name for path in (ROOT / "docs/images").glob("compare-*")}


@pytest.mark.parametrize("marker", [name for name in MARKERS if name.startswith("rigs-")])
def test_tables_of_rigs_are_those_of_the_results(marker: str) -> None:
    suite = MARKERS[marker][0]
    message, (header, *rows) = results()["suites"][suite], table(marker)

    assert {row[0] for row in rows} == {
        name for name, fault in RIGS[suite].items() if f"rigs-{fault.group}" == marker
    }

    assert len(message["scenes"]) == {"rigs": 12, "rigs-2": 6}[suite]

    for name, *figures in rows:
        means = [fmean(message["bad_1"][name][method]) for method in header[1:]]
        for figure, mean in zip(figures, means, strict=True):
            assert float(figure) == pytest.approx(mean, abs=0.0501)


def test_every_table_of_the_documentation_is_filled() -> None:
    text = "".join(page.read_text("utf-8") for page in PAGES)
    for name, place in re.findall(r"<!-- bench:(\S+) -->(.*?)<!-- /bench", text, re.DOTALL):
        assert place.count("|") > 10, name


def test_the_citation_is_of_this_version() -> None:
    yaml = counterpart("yaml")

    content = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    manifest = (ROOT / "Cargo.toml").read_text("utf-8")
    version = re.search(r'^version = "(.*)"$', manifest, re.MULTILINE)

    assert content["version"] == content["preferred-citation"]["version"] == version[1]
    assert content["cff-version"] == "1.2.0"
    assert all(content[key] for key in ("message", "title", "authors", "license"))

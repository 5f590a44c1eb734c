"""The report has the figures of the records: none lost, invented or averaged unfairly."""

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from phasestereo_bench.cases import SUITE_SCENES, SUITES
from phasestereo_bench.datasets import find_scene, find_scenes
from phasestereo_bench.report.cells import Place
from phasestereo_bench.report.documents import document_texts, fill_places
from phasestereo_bench.report.markdown import fill_markers, markdown_table, markdown_text
from phasestereo_bench.report.origin import explain, made_with
from phasestereo_bench.report.plots import draw_means, save_plot, styles
from phasestereo_bench.report.results import Results, read_results
from phasestereo_bench.report.sharp import explain_v3, sharp_tables, v2_table, v3_table
from phasestereo_bench.report.tables import (
    Entry,
    Table,
    mean_table,
    means,
    scene_table,
)

for module in ("matplotlib", "jinja2", "PIL"):
    pytest.importorskip(module)

SUITE = "one-sided-blur"
BLURS = ("gauss 2", "gauss 4", "disk 3", "disk 6", "motion 9", "motion 15")
V2 = ("nonocc", "all", "disc")
ENDINGS = ("", "-v2", "-v3")
DOCUMENTS = Path(__file__).resolve().parents[2] / "docs"
ENVIRONMENT = {
    "kind": "environment",
    "id": "e1",
    "cpu": "A <fast> processor",
    "cores": 2,
    "platform": "Linux",
    "versions": {"python": "3.11.2", "phasestereo": "0.1.0", "numpy": "2.4", "opencv": "5.0"},
    "commit": "0123456789abcdef0123456789abcdef01234567-dirty",
    "date": "2026-11-21",
}


def record(
    method: str, bad: float | None, scene: str = "tsukuba", row: str = "sharp", **fields: Any
) -> dict[str, Any]:
    """Return a record as the harness writes it; without a number, that of a failed cell."""
    knows_blur = method.endswith("+true-blur")
    ours = method.startswith("paper")

    key = {
        "kind": "middlebury",
        "suite": SUITE,
        "collection": "scenes2001",
        "scene": scene,
        "degradation": row,
        "side": "left",
        "method": method.removesuffix("+true-blur"),
        "true_blur": knows_blur,
    }

    if bad is None:
        outcome: dict[str, Any] = {
            "status": "failed",
            "error": "ValueError: no <b> | `here`\nat all",
        }
    else:
        outcome = {
            "status": "ok",
            "v2": {"nonocc": bad, "all": bad + 1, "disc": None},
            "v3": {"bad_2": bad / 2, "avgerr": bad / 10, "rms": float("nan"), "pixels": 100},
            "d1": bad / 4,
            "epe": None,
            "num_disparities": 10,
            "width": 20,
            "height": 5,
            "settings": {"cost": "phase", "window": 9} if ours else {"mode": "HH"},
            "seconds": 2e-3 * bad,
            "peak_bytes": 3_000_000,
        }

    return {**key, **outcome, "environment": "e1", **fields}


def store(path: Path, records: Iterable[dict[str, Any]]) -> Path:
    """Write a store."""
    path.write_text("".join(json.dumps(line) + "\n" for line in (ENVIRONMENT, *records)), "utf-8")
    return path


def texts(table: Table) -> list[list[str]]:
    """Return a table's text, the best in asterisks."""
    return [[f"*{text}*" if best else text for text, best in row] for row in table.rows]


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """Return results of two scenes, in which ours has no result for one of the four cells."""
    records = [
        record("opencv:sgbm", 10.0),
        record("opencv:sgbm", 20.0, "venus"),
        record("opencv:sgbm", 40.0, row="gauss 2"),
        record("opencv:sgbm", 60.0, "venus", row="gauss 2"),
        record("paper:window=11", 30.0),
        record("paper:window=11", 50.0, "venus"),
        record("paper:window=11", 44.0, row="gauss 2"),
        record("paper:window=11", None, "venus", row="gauss 2"),
        record("opencv:sgbm+true-blur", 3.0, row="gauss 2"),
        record("opencv:sgbm+true-blur", 5.0, "venus", row="gauss 2"),
    ]
    return read_results([store(tmp_path_factory.mktemp("small") / "small.jsonl", records)])


@pytest.fixture
def whole(tmp_path: Path) -> Results:
    """Return results of the whole suite: blur number n costs ours 10 + n and SGBM 20 + n."""
    records = []
    for name in SUITE_SCENES[SUITE]:
        collection, _, scene = name.rpartition("/")
        for number, row in enumerate(SUITES[SUITE]):
            for method, base in (("paper", 10.0), ("opencv:sgbm", 20.0), ("paper+true-blur", 5.0)):
                if not method.endswith("blur") or row in BLURS:
                    cell = record(method, base + number, scene, row, collection=collection)
                    records.append(cell)

    return read_results([store(tmp_path / "whole.jsonl", [*records, {"kind": "cost"}])])


# What is averaged


def test_mean_table(small: Results) -> None:
    table = mean_table(small, "v2.nonocc")
    assert table.header == ("method", "sharp", "gauss 2")
    assert texts(table) == [
        ["paper:window=11", "40.0", "44.0"],
        ["opencv:sgbm", "*15.0*", "*40.0*"],
        ["opencv:sgbm+true-blur", "-", "3.0"],
        ["scenes", "2 of 12", "1 of 12"],
    ]


def test_mean_of_the_blurs(whole: Results) -> None:
    table = mean_table(whole, "v2.nonocc")
    assert table.header == ("method", *SUITES[SUITE], "mean of the blurs")

    ours, rival, informed = texts(table)
    rows = list(SUITES[SUITE])
    expected = np.mean([rows.index(row) for row in BLURS])
    assert (ours[-1], rival[-1]) == (f"*{10 + expected:.1f}*", f"{20 + expected:.1f}")
    assert informed[-1] == f"{5 + expected:.1f}"

    assert [text for text, row in zip(informed[1:], rows, strict=False) if row not in BLURS] == [
        "-"
    ] * 3
    assert "Means over 12 scenes" in explain(whole, "v2.nonocc")


def test_scene_table(small: Results) -> None:
    table = scene_table(small, "v2.nonocc")
    assert table.header == ("scene", "left image", *small.methods)
    assert table.labels == 2
    assert texts(table) == [
        ["tsukuba", "sharp", "30.0", "*10.0*", "-"],
        ["tsukuba", "gauss 2", "44.0", "*40.0*", "3.0"],
        ["venus", "sharp", "50.0", "*20.0*", "-"],
        ["venus", "gauss 2", "-", "60.0", "5.0"],
    ]


def test_one_row_has_its_mean_below(tmp_path: Path) -> None:
    records = [
        record(method, bad, scene, suite="sharp")
        for method, bad in (("paper", 5.0), ("sad", 7.0))
        for scene in ("venus", "tsukuba")
    ]

    table = scene_table(read_results([store(tmp_path / "a", records)]), "v2.nonocc")
    assert table.header == ("scene", "paper", "sad")
    assert texts(table)[0] == ["tsukuba", "*5.0*", "7.0"]
    assert texts(table)[-1] == ["mean of 2 of 12", "*5.0*", "7.0"]


def test_equal_figures_are_equally_good(tmp_path: Path) -> None:
    records = [record("paper", 10.04), record("sad", 9.96), record("nsad", 10.06)]
    table = mean_table(read_results([store(tmp_path / "a", records)]), "v2.nonocc")
    assert [row[1] for row in texts(table)[:3]] == ["*10.0*", "10.1", "*10.0*"]


def test_scenes_beyond_the_suite_do_not_count(tmp_path: Path) -> None:
    records = [record("paper", 10.0), record("paper", 90.0, "sawtooth")]
    results = read_results([store(tmp_path / "a", records)])
    assert means(results, "v2.nonocc", ["sharp"]) == (1, {"paper": 10.0})

    assert [row[0].text for row in scene_table(results, "v2.nonocc").rows] == [
        "sawtooth",
        "tsukuba",
        "mean of 1 of 12",
    ]

    mixed = read_results([store(tmp_path / "c", [*records, record("sad", 1.0, "venus")])])
    said = explain(mixed, "v2.nonocc")
    assert "not all methods have them: paper is without venus; sad is without tsukuba." in said
    assert "Not of the suite, and in no mean: sawtooth." in said
    assert "eft out" not in explain(results, "v2.nonocc")

    others = read_results([store(tmp_path / "b", records[1:])])
    assert means(others, "v2.nonocc", ["sharp"]) == (1, {"paper": 90.0})


def test_missing_numbers_are_no_scenes(tmp_path: Path) -> None:
    with_disc = {"nonocc": 10.0, "all": 10.0, "disc": 33.0}
    records = [record("paper", 10.0, v2=with_disc), record("paper", 10.0, "venus")]
    results = read_results([store(tmp_path / "a", records)])
    assert means(results, "v2.disc", ["sharp"]) == (1, {"paper": 33.0})
    assert results.metrics == ("v2.nonocc", "v2.all", "v2.disc", "v3.bad_2", "v3.avgerr", "d1")


def test_more_of_an_area_is_better(tmp_path: Path) -> None:
    records = [record("paper", 1.0, roc=0.9), record("sad", 1.0, roc=0.8), record("nsad", 1.0)]
    results = read_results([store(tmp_path / "a", records)])

    found = texts(mean_table(results, "roc"))
    assert found == [["paper", "*0.900*"], ["nsad", "-"], ["sad", "0.800"]]
    assert "pixels: more is better." in explain(results, "roc")
    assert "pixels, %: less is better." in explain(results, "v2.nonocc")


# Sharp pairs


def sharp_record(method: str, scene: str, bad: float, **fields: Any) -> dict[str, Any]:
    """Return a record of a sharp pair, in the folder where such scenes are."""
    collection = {"cones": "scenes2003", "Piano": "MiddEval3/trainingQ"}.get(scene, "scenes2001")
    regions = {"nonocc": bad, "all": bad + 1, "disc": bad + 5}
    fields = {"v2": regions, "suite": "sharp", "collection": collection, **fields}
    return record(method, bad, scene, **fields)


def test_tables_of_sharp_pairs(tmp_path: Path) -> None:
    records = [
        sharp_record("paper", "tsukuba", 2.0, roc=0.1),
        sharp_record("paper", "cones", 4.0),
        sharp_record("paper", "Piano", 8.0, roc=0.9),
        sharp_record("opencv:sgbm", "tsukuba", 6.0),
        sharp_record("opencv:sgbm", "Piano", 6.0),
    ]

    results = read_results([store(tmp_path / "a", records)])

    regions = [f"{scene} {name}" for scene in ("tsukuba", "cones") for name in V2]
    assert v2_table(results).header == ("method", *regions, "mean")
    assert texts(v2_table(results)) == [
        ["paper", "*2.0*", "*3.0*", "*7.0*", "4.0", "5.0", "9.0", "5.0"],
        ["opencv:sgbm", "6.0", "7.0", "11.0", "-", "-", "-", "-"],
    ]

    assert v3_table(results).header == ("method", "bad-2.0", "mean error", "ROC area")
    assert texts(v3_table(results)) == [
        ["paper", "4.0", "0.80", "0.900"],
        ["opencv:sgbm", "*3.0*", "*0.60*", "-"],
    ]
    assert "over the other 1 scenes" in explain_v3(results)


def test_only_sharp_pairs_have_such_tables(small: Results, tmp_path: Path) -> None:
    assert sharp_tables(small) == {}

    records = [sharp_record("paper", scene, 2.0) for scene in ("venus", "Piano")]
    results = read_results([store(tmp_path / "a", records)])
    path = tmp_path / "sharp.md"
    path.write_text("".join(f"<!-- bench:sharp{n} --><!-- /bench:sharp{n} -->" for n in ENDINGS))

    fill_places(path, document_texts(results))
    for table in (v2_table(results), v3_table(results), scene_table(results, "v2.nonocc")):
        assert markdown_table(table) in path.read_text("utf-8")

    words = " ".join(path.read_text("utf-8").split())
    assert "version 2 of the Middlebury evaluation had them" in words


def test_environments(tmp_path: Path) -> None:
    records = [record("paper", 1.0), record("paper", 1.0, "venus", environment="e2")]
    results = read_results([store(tmp_path / "a", records)])

    words = made_with(results.environments.values())
    assert "phasestereo 0.1.0" in words
    assert "versions that are not known" in words


def test_environments_that_differ_in_commit_and_date_are_named_once() -> None:
    known = {"versions": {"phasestereo": "0.1.0", "numpy": "2.4"}, "cpu": "A"}
    dates = ("2026-11-22", "2026-11-23")
    assert made_with({**known, "commit": date, "date": date} for date in dates) == (
        "Made with phasestereo 0.1.0 on A, 2026-11-22 to 2026-11-23."
    )
    assert made_with([known]) == "Made with phasestereo 0.1.0 on A."


# What is read


def test_last_record_counts_also_over_files(tmp_path: Path) -> None:
    first = store(tmp_path / "a", [record("paper", None), record("paper", 1.0), record("sad", 1.0)])
    second = store(tmp_path / "b", [record("paper", 2.0)])

    results = read_results([first, second])
    assert means(results, "v2.nonocc", ["sharp"]).values == {"paper": 2.0, "sad": 1.0}

    assert results.failures == ()
    assert read_results([second, first]).values("v2.nonocc", "paper", "sharp") == {
        Place("scenes2001", "tsukuba"): 1.0
    }


def test_order_of_telling(tmp_path: Path) -> None:
    methods = (
        *("opencv:sgbm+true-blur", "opencv:sgbm", "sad", "paper:neighborhood=11"),
        *("paper:neighborhood=7+true-blur", "paper:neighborhood=7"),
    )

    baseline = {"cost": "sad"}
    records = [
        record(
            method,
            1.0,
            scene,
            row,
            collection=collection,
            **({"settings": baseline} if method == "sad" else {}),
        )
        for method in methods
        for collection, scene in (
            ("MiddEval3/trainingQ", "Piano"),
            ("scenes2006/ThirdSize", "Aloe"),
            ("scenes2001", "venus"),
            ("scenes2001", "map"),
        )
        for row in ("mixed", "gauss 2", "sharp")
    ]

    results = read_results([store(tmp_path / "a", records)])
    assert results.methods == (
        *("paper:neighborhood=7", "paper:neighborhood=11", "sad", "opencv:sgbm"),
        *("paper:neighborhood=7+true-blur", "opencv:sgbm+true-blur"),
    )
    assert results.degradations == ("sharp", "gauss 2", "mixed")
    assert [place.scene for place in results.places] == ["map", "venus", "Aloe", "Piano"]

    chosen = ("opencv:sgbm", "paper:neighborhood=11")
    assert read_results([tmp_path / "a"], methods=chosen).methods == chosen


def test_scenes_of_one_name_are_told_apart(tmp_path: Path) -> None:
    records = [record("paper", 1.0, "Art", collection=f"scenes2005/{size}") for size in ("A", "B")]
    table = scene_table(read_results([store(tmp_path / "a", records)]), "v2.nonocc")
    assert [row[0].text for row in table.rows[:2]] == ["scenes2005/A/Art", "scenes2005/B/Art"]


def refused(tmp_path: Path, records: list[dict[str, Any]], **choice: Any) -> str:
    """Return the message that refuses such a store."""
    with pytest.raises(ValueError, match=".") as caught:
        read_results([store(tmp_path / "refused.jsonl", records)], **choice)
    return str(caught.value)


def test_refusals_of_content(tmp_path: Path) -> None:
    assert "no record of the kind 'middlebury'" in refused(tmp_path, [{"kind": "paper"}])
    assert "all 1 cells failed, ValueError: no <b>" in refused(tmp_path, [record("paper", None)])
    nameless = {**record("paper", 1.0), "method": 7}
    message = refused(tmp_path, [record("paper", 1.0), nameless])
    assert message.endswith("refused.jsonl: line 3: method must be a text, got 7")


def test_refusals_of_choice(tmp_path: Path) -> None:
    mixed = [record("paper", 1.0), record("paper", 1.0, suite="sharp")]

    assert "suite: got none" in refused(tmp_path, mixed)
    assert "one-sided-blur, sharp" in refused(tmp_path, mixed, suite="none")
    assert read_results([tmp_path / "refused.jsonl"], suite="sharp").suite == "sharp"

    sides = [record("paper", 1.0), record("paper", 2.0, side="right")]
    assert "side: got none" in refused(tmp_path, sides)
    results = read_results([tmp_path / "refused.jsonl"], side="right")
    assert means(results, "v2.nonocc", ["sharp"]).values == {"paper": 2.0}
    assert "side: got 'top'; accepts" in refused(tmp_path, sides, side="top")

    message = refused(tmp_path, [record("paper", 1.0)], methods=["paper", "sad"])
    assert message == "method: got 'sad'; accepts those with results: paper"


# What is written


def test_ours_stands_out(tmp_path: Path) -> None:
    records = [record(f"paper:window={size}", 50.0 - size) for size in (5, 7, 9)]
    records += [record("opencv:sgbm", 1.0), record("paper:window=7+true-blur", 1.0)]

    results = read_results([store(tmp_path / "a", records)])
    looks = styles(results, "v2.nonocc")
    assert looks["paper:window=9"].color == "#0b66c3"
    assert len({look.color for look in looks.values()}) == 4
    for file in ("one.svg", "two.svg"):
        save_plot(draw_means(results, "v2.nonocc"), tmp_path / file)
    drawn = (tmp_path / "one.svg").read_text("utf-8")
    assert all(look.color in drawn.lower() for look in looks.values())
    assert drawn == (tmp_path / "two.svg").read_text("utf-8")

    plain, message = looks["paper:window=7"], looks["paper:window=7+true-blur"]
    assert (plain.color, plain.mark, plain.hollow, message.hollow) == (
        message.color,
        message.mark,
        False,
        True,
    )


# Markdown and markers


def test_markdown_shows_text_as_it_is() -> None:
    table = Table(("a|b", "n"), ((Entry("x_y *z* <b> [l] `c`\n\\"), Entry("1.0", best=True)),))
    header, rule, row = markdown_table(table).split("\n")
    assert (header, rule) == (r"| a\|b | n |", "| --- | ---: |")
    assert row == r"| x\_y \*z\* &lt;b&gt; \[l\] \`c\` \\ | **1.0** |"
    assert markdown_text("a &\n b") == "a &amp; b"


def test_markers_are_filled_and_filled_again() -> None:
    document = (
        "Before\n<!-- bench:a --><!-- /bench:a -->\n<!--bench:b-->old\n<!-- /bench:b --> after\n"
    )
    filled = fill_markers(document, {"a": "| A |", "b": "B"})
    assert filled == (
        "Before\n<!-- bench:a -->\n\n| A |\n\n<!-- /bench:a -->\n"
        "<!--bench:b-->\n\nB\n\n<!-- /bench:b --> after\n"
    )

    assert fill_markers(filled, {"a": "| A |", "b": "B"}) == filled
    assert "\r\n\r\nx\r\ny\r\n\r\n" in fill_markers(
        "<!-- bench:a --><!-- /bench:a -->\r\n", {"a": "x\ny"}
    )

    kept = fill_markers(document, {"a": "A"})
    assert "<!--bench:b-->old\n<!-- /bench:b -->" in kept


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ("no marker", "no marker to fill; accepts <!-- bench:a -->"),
        ("<!-- bench:b --><!-- /bench:b -->", "no marker to fill"),
        ("<!-- bench:a -->", "marker <!-- bench:a --> has no counterpart"),
        ("<!-- bench:a --><!-- bench:b --><!-- /bench:b -->", "marker <!-- bench:a --> has no"),
        ("<!-- bench:a --><!-- /bench:b -->", "marker <!-- bench:a --> has no counterpart"),
        ("<!-- /bench:a --><!-- bench:a -->", "marker <!-- /bench:a --> has no counterpart"),
    ],
)
def test_refusals_of_documents(document: str, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        fill_markers(document, {"a": "A"})


def test_documents_are_replaced_as_a_whole(whole: Results, tmp_path: Path) -> None:
    path = tmp_path / "README.md"
    places = ["<!-- bench:one-sided-blur-means --><!-- /bench:one-sided-blur-means -->"]
    places.append("<!-- bench:sharp -->kept<!-- /bench:sharp -->")
    document = "\n".join(["# Ä", *places])
    path.write_text(document, "utf-8")

    fill_places(path, document_texts(whole))
    filled = path.read_text("utf-8")
    assert markdown_table(mean_table(whole, "v2.nonocc")) in filled
    assert filled.startswith("# Ä\n")
    assert "<!-- bench:sharp -->kept<!-- /bench:sharp -->" in filled

    for fact in ("Means over 12 scenes", "left image degraded"):
        assert fact in filled.replace("\n", " ")

    before = path.stat()
    fill_places(path, document_texts(whole))
    assert path.stat() == before

    path.write_text("<!-- bench:sharp --><!-- /bench:sharp -->", "utf-8")
    with pytest.raises(ValueError, match=r"README.md: no marker to fill"):
        fill_places(path, document_texts(whole))
    assert [entry.name for entry in tmp_path.iterdir() if entry.name.startswith(".")] == []


# The command


@pytest.fixture
def cli() -> Any:
    """Return the module of the command line."""
    return pytest.importorskip("phasestereo.cli")


@pytest.mark.usefixtures("whole")
def test_command(tmp_path: Path, cli: Any, capsys: pytest.CaptureFixture[str]) -> None:
    source, plot = str(tmp_path / "whole.jsonl"), tmp_path / "means.png"
    arguments = ["bench", "report", source, "-o", str(plot)]

    assert cli.run(arguments) == 0
    out, err = capsys.readouterr()
    assert err == ""

    assert re.search(r"paper +10\.0 +11\.0 .* 13\.5", out)
    assert f"Wrote {plot}" in out
    assert "Left out, records of other benchmarks: cost\n" in out
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert "Made with phasestereo 0.1.0 on" in " ".join(out.split())

    chosen = ["--method", "opencv:sgbm", "--metric", "v3.bad_2", "--side", "left", "--suite", SUITE]
    assert cli.run(["bench", "report", source, *chosen]) == 0
    out = capsys.readouterr().out
    assert "paper" not in out
    assert "Bad-2.0" in out


def test_command_refuses(tmp_path: Path, cli: Any, capsys: pytest.CaptureFixture[str]) -> None:
    source = str(store(tmp_path / "small.jsonl", [record("paper", 1.0)]))
    base = ["bench", "report", source, "-o", str(tmp_path / "out.svg")]

    cases = [
        (["bench", "report"], 1, "no file"),
        (["bench", "report", str(tmp_path / "missing")], 1, "missing: No such file"),
        ([*base, "--metric", "bad"], 2, "--metric: got 'bad'"),
        ([*base, "--side", "right"], 2, "--side: got 'right'"),
        ([*base, "--method", "sad"], 2, "--method: got 'sad'"),
        ([*base[:3], "-o", str(tmp_path / "a.pdf")], 2, "--output: got"),
    ]

    for arguments, code, message in cases:
        assert cli.run(arguments) == code
        line = capsys.readouterr().err
        assert line.startswith("phasestereo: error: ")
        assert message in line

    assert not (tmp_path / "out.svg").exists()


# The document that defines the suite


def rows_of(document: str, heading: str) -> list[list[str]]:
    """Return the rows of the table under a header that begins so."""
    table, _, _ = document[document.index(f"| {heading} |") :].partition("\n\n")
    lines = table.splitlines()[2:]
    return [[cell.strip().strip("`") for cell in line.strip("|").split("|")] for line in lines]


def test_document_names_the_rows_and_scenes_of_the_suite() -> None:
    document = (DOCUMENTS / "suites.md").read_text("utf-8")
    named = [name for first, *_ in rows_of(document, "row | what") for name in first.split("`, `")]
    assert named == list(SUITES[SUITE])
    assert {
        f"{row[0]}/{row[1]}" for row in rows_of(document, "collection | scene")
    } == SUITE_SCENES[SUITE]


def test_document_is_right_about_the_data(data: Path) -> None:
    document = (DOCUMENTS / "suites.md").read_text("utf-8")

    scenes = {str(scene): scene for scene in find_scenes(data / "middlebury")}
    for collection, name, size, ndisp, scored in rows_of(document, "collection | scene"):
        pair = scenes[f"{collection}/{name}"].load()
        height, width = pair.left.shape[:2]
        assert (size, int(ndisp)) == (f"{width} x {height}", pair.num_disparities)
        assert int(scored) == np.count_nonzero(pair.masks["nonocc"])


def test_document_is_right_about_the_degradations(data: Path) -> None:
    _, *lines = (DOCUMENTS / "one-sided-blur-sums.csv").read_text("utf-8").splitlines()
    pair = find_scene(data / "middlebury", "tsukuba").load()
    for row, *sums in (line.split(",") for line in lines):
        degrade = SUITES[SUITE][row]
        images = degrade(pair.left), degrade(pair.right)
        assert [int(total) for total in sums] == [
            int(image.sum(dtype=np.int64)) for image in images
        ]

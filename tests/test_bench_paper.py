"""The paper's experiments: what is blurred, chosen and claimed, and a small run of it all."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from html_page import Page
from phasestereo import io
from phasestereo.settings import Settings
from phasestereo_bench.degradation import suite
from phasestereo_bench.paper import cells, claims, load_pairs, run_study
from phasestereo_bench.paper.blurs import Blur, box_psf
from phasestereo_bench.paper.cells import SCENES, Cell, measure
from phasestereo_bench.paper.choices import FULL_GRID, QUICK_GRID, candidates, choose
from phasestereo_bench.paper.claims import (
    WAYS,
    Verdict,
    better_in_all_cases,
    case_of,
    cases,
    flat_in_bits,
    flatness,
    gains_at_larger_blurs,
)
from phasestereo_bench.paper.exhibit import write_page
from phasestereo_bench.paper.experiments import (
    AREAS,
    BITS,
    BITS_KEY,
    BITS_SIGMAS,
    EXPERIMENTS,
    GAUSS,
    MAPS_LEVEL,
    MOTION_X,
    MOTION_Y,
    PROTOCOLS,
    SHARP,
    Experiment,
    Series,
)
from phasestereo_bench.paper.methods import METHODS, NSAD, PHASE, SAD, Grid, recoded
from phasestereo_bench.paper.prototype import figures
from phasestereo_bench.paper.readings import Reading, curve
from phasestereo_bench.paper.reasons import reasons, short_levels
from phasestereo_bench.paper.wording import span

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from phasestereo_bench.paper.study import Study

for module in ("PIL", "scipy", "matplotlib", "jinja2"):
    pytest.importorskip(module)
cli = pytest.importorskip("phasestereo.cli")
bench_paper = pytest.importorskip("phasestereo_bench.cli.bench_paper")

# What is blurred, and how much.


def test_every_experiment_has_eight_levels_and_few_for_a_trial() -> None:
    for experiment in EXPERIMENTS:
        assert len(experiment.levels) >= 8
        assert list(experiment.levels) == sorted(set(experiment.levels))
        assert set(experiment.quick_levels) < set(experiment.levels)
    ends = [(experiment.levels[0], experiment.levels[-1]) for experiment in EXPERIMENTS]
    assert ends == [(1, 21), (1, 21), (0, 5), (3, 15)]
    assert MAPS_LEVEL in AREAS.quick_levels
    assert [experiment.power for experiment in EXPERIMENTS] == [2, 2, 1, 1]


def test_tied_settings_hold_the_blur_and_are_valid() -> None:
    for experiment in EXPERIMENTS:
        for level in experiment.levels:
            window = experiment.window(level)
            assert window >= max(7, experiment.size(level))
            for rule in experiment.rules:
                side = experiment.neighborhood(level, rule)
                Settings(window=window, neighborhood=side, power=experiment.power)
                assert side >= 7
                assert experiment is GAUSS or side >= 2 * level
    assert [MOTION_X.neighborhood(15, rule) for rule in MOTION_X.rules] == [31, 45]
    assert MOTION_X.window(15) == 15
    assert GAUSS.window(4) == GAUSS.neighborhood(4, GAUSS.rules[0]) == 17


def test_box_is_as_long_as_it_says() -> None:
    np.testing.assert_allclose(box_psf(5), np.full((1, 5), 0.2))
    np.testing.assert_allclose(box_psf(4), [[0.125, 0.25, 0.25, 0.25, 0.125]])
    np.testing.assert_array_equal(box_psf(1), [[1.0]])
    at = np.arange(-5, 6)
    assert box_psf(11)[0] @ np.cos(2 * np.pi * at / 11) == pytest.approx(0, abs=1e-15)


@pytest.fixture(scope="module")
def noise_image() -> np.ndarray:
    """Return an image in which every degradation shows."""
    return np.random.default_rng(1).integers(0, 256, (41, 43, 3), np.uint8)


@pytest.mark.parametrize(
    ("blur", "row"),
    [
        (Blur("gauss", 2, "suite"), "gauss 2"),
        (Blur("motion x", 9, "suite"), "motion 9"),
        (Blur("areas", 11, "suite"), "mixed"),
    ],
)
def test_the_suites_recipe_is_that_of_the_suite(
    blur: Blur, row: str, noise_image: np.ndarray
) -> None:
    np.testing.assert_array_equal(blur(noise_image), suite()[row](noise_image))


def test_motion_smears_one_direction_without_noise(noise_image: np.ndarray) -> None:
    rows = np.repeat(noise_image[:, :1], 43, axis=1)  # constant along x
    np.testing.assert_array_equal(Blur("motion x", 11)(rows), rows)
    assert (Blur("motion y", 11)(rows) != rows).any()
    smeared = Blur("motion x", 5)(noise_image)
    wanted = np.rint(noise_image[20, 18:23].mean(axis=0))
    np.testing.assert_array_equal(smeared[20, 20], wanted)


def test_areas_alternate(noise_image: np.ndarray) -> None:
    mixed = Blur("areas", 5)(noise_image)
    rows, columns = np.arange(5) * 41 // 4, np.arange(5) * 43 // 4

    def area(image: np.ndarray, i: int, j: int) -> np.ndarray:
        return image[rows[i] : rows[i + 1], columns[j] : columns[j + 1]]

    dimmed = np.rint(0.6 * noise_image + 20)
    for i, j in np.ndindex(4, 4):
        versions = [dimmed, Blur("motion x", 5)(noise_image), noise_image]
        if (i + j) % 4 < 3:
            np.testing.assert_array_equal(area(mixed, i, j), area(versions[(i + j) % 4], i, j))
    assert area(mixed, 0, 3).std() < 0.4 * area(noise_image, 0, 3).std()  # out of focus


# What is chosen.


def test_all_grids_hold_what_the_tied_protocol_needs() -> None:
    assert len(candidates()) == len(SCENES) * (len(METHODS) + 1)  # phase codes with k = 1 and 2
    for whose in candidates():
        measured = whose.cells(FULL_GRID)
        assert len(measured) == len(set(measured))
        assert all(cell.blur == SHARP for cell in measured)
        assert {Cell(whose.scene, SHARP, each) for each in whose.tied} <= set(measured)


def test_the_best_is_chosen_and_the_first_of_equals() -> None:
    whose = next(each for each in candidates() if each.method is PHASE)
    bad = dict.fromkeys(whose.cells(FULL_GRID), 10.0)
    first = whose.method.candidates(FULL_GRID, whose.power)[0]
    assert choose(whose, FULL_GRID, bad).fixed == first
    best = PHASE.settings(window=11, neighborhood=15, penalty=2, power=whose.power)
    tied = PHASE.settings(window=7, neighborhood=7, penalty=4, power=whose.power)
    bad |= {Cell(whose.scene, SHARP, best): 5.0, Cell(whose.scene, SHARP, tied): 6.0}
    choice = choose(whose, FULL_GRID, bad)
    assert (choice.fixed, choice.fixed_bad) == (best, 5.0)
    assert (choice.penalty, choice.penalty_bad) == (4, 6.0)


def test_penalty_follows_the_bits() -> None:
    settings = Settings(penalty=2.0)
    assert [recoded(settings, bits).penalty for bits in BITS] == [1, 2, 4, 8]


def test_baselines_have_no_neighborhood() -> None:
    grid = Grid((7, 9), (7, 11))
    assert len(SAD.candidates(grid, 1)) == 2 * len(SAD.penalties)
    assert SAD.candidates(grid, 1) == SAD.candidates(grid, 2)
    assert len(PHASE.candidates(grid, 1)) == 4 * len(PHASE.penalties)


# What is claimed.


def synthetic(value: Callable[[Experiment, str, Series, float], float]) -> list[Reading]:
    """Return the readings of Figure 2 that a function gives."""
    return [
        Reading(
            experiment=experiment.key,
            scene=scene,
            protocol=protocol,
            method=series.method.cost,
            rule=series.rule,
            level=level,
            power=experiment.power,
            bits=2,
            neighborhood=experiment.neighborhood(level, series.rule) if series.rule else 7,
            window=7,
            penalty=1.0,
            nonocc=value(experiment, scene, series, level),
            all=None,
            disc=None,
        )
        for experiment in EXPERIMENTS
        for scene in SCENES
        for protocol in PROTOCOLS
        for series in experiment.series(protocol)
        for level in experiment.levels
    ]


def lines(value: Callable[[int], float]) -> list[Reading]:
    """Return the readings of Figure 3 that a function of the bits gives."""
    template = synthetic(lambda *_: 0.0)[0]
    return [
        replace(
            template,
            experiment=BITS_KEY,
            scene=scene,
            protocol=protocol,
            level=sigma,
            bits=bits,
            nonocc=value(bits),
        )
        for scene in SCENES
        for protocol in PROTOCOLS
        for sigma in BITS_SIGMAS
        for bits in BITS
    ]


def winning(_: Experiment, __: str, series: Series, level: float) -> float:
    """Give phase codes 1 point at any blur and 7 at the largest."""
    return 20 + level if series.method is PHASE else 21 + level + min(level, 6)


def test_claims_are_reproduced_by_what_reproduces_them() -> None:
    readings = synthetic(winning)
    for way in WAYS:
        found = cases(readings, way)
        assert len(found) == len(EXPERIMENTS) * len(SCENES)
        assert all(case.is_better_throughout for case in found)
        assert better_in_all_cases(found) is Verdict.YES
        assert gains_at_larger_blurs(found) is Verdict.YES
    gains = case_of(readings, MOTION_X, "cones", WAYS[0])
    assert gains.levels[0] == 3  # 1 is no blur
    assert gains.sharp == (21, 23)
    assert gains.gains[3] == pytest.approx(4)
    assert gains.larger_gains == dict.fromkeys((13, 15, 17, 19, 21), 7)


def test_claims_are_not_reproduced_by_what_does_not() -> None:
    readings = synthetic(lambda *where: 60 - winning(*where))
    for way in WAYS:
        found = cases(readings, way)
        assert better_in_all_cases(found) is Verdict.NO
        assert gains_at_larger_blurs(found) is Verdict.NO


def test_one_loss_is_reproduced_in_part() -> None:
    def almost(experiment: Experiment, scene: str, series: Series, level: float) -> float:
        lost = (experiment, scene, level) == (AREAS, "cones", 3) and series.method is PHASE
        return 99 if lost else winning(experiment, scene, series, level)

    assert better_in_all_cases(cases(synthetic(almost), WAYS[0])) is Verdict.PARTLY


def test_small_gains_are_not_large_ones() -> None:
    readings = synthetic(lambda *where: 20.0 if where[2].method is PHASE else 24.9)
    found = cases(readings, WAYS[0])
    assert better_in_all_cases(found) is Verdict.YES
    assert gains_at_larger_blurs(found) is Verdict.NO


def test_the_rival_is_the_papers_and_the_better_one_is_told_apart() -> None:
    values = {PHASE.cost: 20.0, SAD.cost: 10.0, NSAD.cost: 30.0}
    readings = synthetic(lambda *where: values[where[2].method.cost])
    for case in cases(readings, WAYS[0]):
        gain = 10 if case.experiment is AREAS else -10
        assert set(case.gains.values()) == {gain}
        assert set(case.gains_over_best.values()) == {-10}


def test_flatness() -> None:
    assert flat_in_bits(flatness(lines(lambda bits: 10 + 0.5 * bits))) is Verdict.YES
    uneven = flatness(lines(lambda bits: 13 if bits == 1 else 10))
    assert flat_in_bits(uneven) is Verdict.NO
    assert (len(uneven), uneven[0].spread, uneven[0].spread_from_two) == (12, 3, 0)
    text = claims([*synthetic(winning), *lines(lambda bits: 13 if bits == 1 else 10)])[-1]
    assert [finding.verdict for finding in text.findings] == [Verdict.NO, Verdict.NO]
    assert "spreads over 3.0: that is b = 1" in text.findings[0].text


def test_levels_in_words() -> None:
    among = [1.0, 2.0, 2.5, 3.0, 7.0]
    assert span([3.0, 1.0, 2.0], among) == "1 to 2, 3"
    assert span(among, among) == "1 to 7"
    assert span([2.5], among) == "2.5"


# Why a claim does not hold.


def told(readings: list[Reading], experiment: Experiment, way: int) -> dict[str, list[float]]:
    """Return the reasons of a case on Cones by their first words."""
    found = reasons(case_of(readings, experiment, "cones", WAYS[way]), readings)
    return {" ".join(reason.text.split()[:3]): reason.levels for reason in found}


def test_every_level_that_falls_short_has_one_reason() -> None:
    readings = synthetic(lambda *where: 60 - winning(*where))
    for way in WAYS:
        for case in cases(readings, way):
            levels = [level for reason in reasons(case, readings) for level in reason.levels]
            assert sorted(levels) == short_levels(case) == list(case.levels)


def test_a_neighborhood_too_small_is_blamed() -> None:
    readings = synthetic(lambda *where: 60 - winning(*where))
    found = told(readings, MOTION_X, 2)
    assert found["L = 7,"] == [5.0, 7.0, 9.0, 11.0, 13.0, 15.0, 17.0, 19.0, 21.0]


def test_a_motion_along_columns_is_blamed() -> None:
    readings = synthetic(lambda *where: 60 - winning(*where))
    assert told(readings, MOTION_Y, 0)["motion along y"] == [13.0, 15.0, 17.0, 19.0, 21.0]
    assert "motion along y" not in told(readings, MOTION_X, 0)


def test_a_worse_rule_is_blamed() -> None:
    def value(_: Experiment, __: str, series: Series, ___: float) -> float:
        return {"2n + 1": 30.0, "3n": 20.0}.get(series.rule, 25.0)

    readings = synthetic(value)
    reason = reasons(case_of(readings, MOTION_X, "cones", WAYS[0]), readings)[0]
    assert reason.levels == list(MOTION_X.levels[1:])
    assert "next to the first zero" in reason.text
    assert "L = 3n has 20.0 % wrong there, this one 30.0" in reason.text
    worse = {"2n + 1": 20.0, "3n": 30.0}
    readings = synthetic(lambda *where: worse.get(where[2].rule, 25.0))
    reason = reasons(case_of(readings, MOTION_X, "cones", WAYS[1]), readings)[0]
    assert "L = 3n is more than this blur needs" in reason.text


def test_a_handicap_on_the_sharp_pair_is_blamed() -> None:
    readings = synthetic(lambda *where: 22.0 if where[2].method is PHASE else 20.0)
    assert told(readings, MOTION_X, 0) == {"on the sharp": list(MOTION_X.levels[1:])}
    assert told(readings, AREAS, 0) == {"on the sharp": list(AREAS.levels)}


def test_what_is_level_needs_no_reason() -> None:
    readings = synthetic(lambda *_: 20.0)
    assert told(readings, GAUSS, 0) == {"the two are": list(GAUSS.levels[1:])}


# A small run of it all.


@pytest.fixture(scope="module")
def middlebury(data: Path) -> Path:
    """Return the folder tree of pairs."""
    return data / "middlebury"


@pytest.fixture(scope="module")
def folder(middlebury: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with what the command wrote in a quick run."""
    target = tmp_path_factory.mktemp("paper") / "new" / "folder"
    command = ["bench", "paper", str(middlebury), "-o", str(target), "--quick", "--workers", "2"]
    assert cli.run(command) == 0
    return target


@pytest.fixture(scope="module")
def study(middlebury: Path, folder: Path) -> Study:
    """Return what the quick run measured, from its store."""
    return run_study(load_pairs(middlebury), folder / "results.jsonl", quick=True, workers=0)


def test_resumption_measures_nothing_again(
    middlebury: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(**_: object) -> None:
        raise AssertionError("measured again")

    before = (folder / "results.jsonl").read_bytes()
    monkeypatch.setattr(cells, "score_cell", never)
    again = run_study(load_pairs(middlebury), folder / "results.jsonl", quick=True, workers=0)
    assert (folder / "results.jsonl").read_bytes() == before
    assert again.readings


def test_every_point_was_measured(study: Study) -> None:
    for experiment in EXPERIMENTS:
        for scene in SCENES:
            for protocol in PROTOCOLS:
                for series in experiment.series(protocol):
                    line = curve(
                        study.readings,
                        experiment=experiment.key,
                        scene=scene,
                        protocol=protocol,
                        method=series.method.cost,
                        rule=series.rule,
                    )
                    assert tuple(line) == experiment.quick_levels
                    assert all(0 < bad < 100 for bad in line.values())
    assert study.grid == QUICK_GRID


def test_figures_of_the_prototype_come_out_again(study: Study) -> None:
    assert len(study.prototype) >= 12
    for figure, measured, _ in study.prototype:
        assert measured == pytest.approx(figure.published, abs=0.2)
    everything = {(f.cell.scene, f.experiment.key, f.method.cost) for f in figures()}
    assert ("cones", "motion_x", "sad") in everything
    assert ("cones", "gauss", "phase") in everything


def test_phase_codes_win_where_the_paper_says_most(study: Study) -> None:
    gains = case_of(study.readings, GAUSS, "cones", WAYS[0]).gains
    assert gains[4] > 10
    assert case_of(study.readings, AREAS, "tsukuba", WAYS[0]).gains[11] > 5


def test_numbers_are_in_the_files(study: Study, folder: Path) -> None:
    rows = []
    for name in ("experiment1", "experiment2", "experiment3", "figure3"):
        with (folder / f"{name}.csv").open(newline="", encoding="utf-8") as file:
            rows += list(csv.DictReader(file))
    assert [float(row["nonocc"]) for row in rows] == [each.nonocc for each in study.readings]
    assert [float(row["level"]) for row in rows] == [each.level for each in study.readings]
    assert {row["rule"] for row in rows} == {"", "2n + 1", "3n", "4 sigma + 1"}
    assert all((row["neighborhood"] == "") == (row["method"] != "phase") for row in rows)
    with (folder / "claims.csv").open(newline="", encoding="utf-8") as file:
        verdicts = [row["verdict"] for row in csv.DictReader(file)]
    found = [finding for claim in claims(study.readings) for finding in claim.findings]
    assert verdicts == [finding.verdict.value for finding in found]


def test_figures_are_pictures(folder: Path) -> None:
    for number in (2, 3, 5):
        for protocol in PROTOCOLS:
            stem = f"figure{number}_{protocol}"
            picture = io.read_image(folder / f"{stem}.png")
            assert min(picture.shape[:2]) > 300
            assert picture.std() > 10
            drawing = ET.parse(folder / f"{stem}.svg").getroot()  # noqa: S314 - our own file
            assert drawing.tag.endswith("svg")
            assert len(list(drawing.iter())) > 50


def test_maps_are_those_of_the_figures(study: Study, folder: Path) -> None:
    maps = folder / "figure5_maps"
    for protocol in PROTOCOLS:
        names = {f"{scene}_{method}.pfm" for scene in SCENES for method in ("sad", "nsad", "phase")}
        names |= {f"{scene}_truth.pfm" for scene in SCENES}
        assert {path.name for path in (maps / protocol).iterdir()} == names
    truth = io.read_disparity(maps / "tied" / "cones_truth.pfm")
    phase = io.read_disparity(maps / "tied" / "cones_phase.pfm")
    known = np.isfinite(truth)
    assert (np.abs(phase - truth)[known] > 1).mean() < 0.5
    assert phase.shape == truth.shape == (375, 450)
    assert study.choices


def test_page_tells_the_claims_and_needs_nothing_else(study: Study, folder: Path) -> None:
    page = Page()
    page.feed((folder / "paper.html").read_text("utf-8"))
    assert page.open == []
    assert len(page.sources) == 6
    assert all(source.startswith("data:image/") for source in page.sources)
    plain = (folder / "paper.md").read_text("utf-8")
    for text in (page.text, plain):
        assert "quick trial" in text
        for claim in claims(study.readings):
            assert claim.quote in text
            for finding in claim.findings:
                assert f"{finding.way}: {finding.verdict.value}" in text
        for figure, measured, _ in study.prototype:
            assert f"{figure.published:.1f}" in text
            assert f"{measured:.1f}" in text
    for name in PROTOCOLS:
        assert f"](figure2_{name}.svg)" in plain


def test_a_whole_study_is_no_trial(study: Study, folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    files = write_page(replace(study, quick=False), tmp_path / "results.jsonl", tmp_path)
    assert files == [tmp_path / "paper.md", tmp_path / "paper.html"]
    assert all("quick trial" not in path.read_text("utf-8") for path in files)


def test_the_command_tells_the_verdicts(
    study: Study,
    middlebury: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: dict[str, object] = {}

    def run(*_: object, **options: object) -> Study:
        asked.update(options)
        return study

    monkeypatch.setattr(bench_paper, "run_study", run)
    monkeypatch.setattr(bench_paper, "write_study", lambda *_: [tmp_path / "paper.html"])
    assert cli.run(["bench", "paper", str(middlebury), "-o", str(tmp_path), "--workers", "3"]) == 0
    assert (asked["workers"], asked["quick"]) == (3, False)
    out, err = capsys.readouterr()
    assert "better in all" in out
    assert str(tmp_path / "paper.html") in out.replace("\n", "")
    assert err == ""


def test_an_interrupted_run_says_how_to_go_on(
    middlebury: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(bench_paper, "run_study", interrupted)
    with pytest.raises(KeyboardInterrupt):
        cli.run(["bench", "paper", str(middlebury), "-o", str(tmp_path)])
    assert "results.jsonl keeps what is done; the same command goes on" in capsys.readouterr().err


def test_a_failed_cell_is_told_and_the_others_kept(
    middlebury: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs = load_pairs(middlebury)
    good = Cell("tsukuba", SHARP, SAD.settings(window=7, penalty=10))
    bad = replace(good, scene="cones")
    whole = cells.score_cell

    def score(folder: str, cell: Cell) -> object:
        if cell == bad:
            raise MemoryError("no room")
        return whole(folder, cell)

    monkeypatch.setattr(cells, "score_cell", score)
    with pytest.raises(RuntimeError, match=r"1 of 2 cells failed.*MemoryError: no room"):
        measure([good, bad, good], pairs, tmp_path / "results.jsonl", workers=0)
    lines = [json.loads(line) for line in (tmp_path / "results.jsonl").read_text().splitlines()]
    kept = [line["scene"] for line in lines if line.get("status") == "ok"]
    assert kept == ["tsukuba"]


def test_another_pair_of_the_same_name_is_another_cell(middlebury: Path) -> None:
    pairs = load_pairs(middlebury)
    cell = Cell("cones", SHARP, SAD.settings(window=7, penalty=10))
    other = replace(pairs, digests={**pairs.digests, "cones": "0"})
    assert cell.job(pairs).key != cell.job(other).key
    assert cell.job(pairs).key == cell.job(load_pairs(middlebury)).key


def refusal(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    """Return the exit code and the one line of a command that refuses."""
    code = cli.run(["bench", "paper", *map(str, arguments)])
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("phasestereo: error: ")
    assert err.count("\n") == 1
    return code, err


def test_refusals(middlebury: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, line = refusal(capsys, tmp_path / "nowhere")
    assert (code, "no such folder" in line) == (1, True)
    (tmp_path / "empty").mkdir()
    code, line = refusal(capsys, tmp_path / "empty")
    assert (code, "no Middlebury scene in" in line) == (1, True)
    code, line = refusal(capsys, middlebury / "scenes2003", "-o", tmp_path / "out")
    assert (code, "'scenes2001/tsukuba' is not a scene in" in line) == (1, True)
    assert not (tmp_path / "out").exists()
    (tmp_path / "file").touch()
    code, line = refusal(capsys, middlebury, "-o", tmp_path / "file")
    assert (code, "File exists" in line) == (1, True)
    code, line = refusal(capsys, middlebury, "-o", tmp_path / "out", "--workers", "-1")
    assert (code, "--workers: got -1" in line) == (2, True)


def test_a_pair_that_cannot_be_scored_is_refused(
    middlebury: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for scene in SCENES.values():
        shutil.copytree(middlebury / scene, tmp_path / scene)
    (tmp_path / SCENES["tsukuba"] / "mask_nonocc.png").unlink()
    code, line = refusal(capsys, tmp_path, "-o", tmp_path / "out")
    assert code == 1
    assert "tsukuba: has no truth with a mask" in line
    assert "mask_nonocc.png" in line


def test_results_of_something_else_are_refused(
    middlebury: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "results.jsonl").write_text("mine\n")
    code, line = refusal(capsys, middlebury, "-o", tmp_path, "--quick")
    assert (code, "not a file of benchmark results" in line) == (1, True)
    assert (tmp_path / "results.jsonl").read_text() == "mine\n"

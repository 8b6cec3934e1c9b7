"""Methods beside each other on paper: the table, the files, the figures and the page."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from slkit.data import PointCloud
from slkit.report.comparison import (
    COLUMNS,
    Comparison,
    Method,
    calibration_table,
    comparison_csv,
    comparison_json,
    methods_table,
)
from slkit.report.comparison_figures import _values, comparison_sections
from slkit.report.figures import View, draw_cloud
from slkit.report.html import comparison_report
from slkit.simulation import paper_rig

SETTINGS = {"roughness_radius_mm": 4.0, "camera_blur_px": 0.6, "projector_blur_px": 0.5}


def plate(rng: np.random.Generator, step: int, noise_mm: float) -> tuple[PointCloud, np.ndarray]:
    """A plate at 1 m whose points lie off it by noise along z; every `step`-th pixel of a row."""
    rig = paper_rig()
    col, row = np.meshgrid(np.arange(200, 560, step), np.arange(150, 430, 4))
    xy = np.stack([col.ravel(), row.ravel()], axis=-1)
    away = rng.normal(0, noise_mm, len(xy))
    rays = np.column_stack([rig.camera.normalize(xy), np.ones(len(xy))])
    count = len(xy)
    cloud = PointCloud(
        (rays * (1000 - away)[:, None]).astype(np.float32),
        np.full((count, 3), 0.5, np.float32),
        np.full(count, 0.2, np.float32),
        np.full(count, np.nan, np.float32),
        xy.astype(np.float32),
        sigma_cal_mm=np.full(count, 0.1, np.float32),
    )
    return cloud, away


@pytest.fixture
def comparison(rng: np.random.Generator) -> Comparison:
    methods = []
    for name, patterns, step, noise in (("dense one", 28, 2, 0.1), ("sparse", 1, 8, 0.6)):
        cloud, away = plate(rng, step, noise)
        numbers = {
            "patterns": patterns,
            "capture_s": patterns / 60,
            "points": len(cloud),
            "completeness_share": 0.5,
            "rms_mm": noise,
            "roughness_mm": noise,
            "limit_mm": noise / 2 if step == 2 else float("nan"),
            "efficiency_ratio": 2.0 if step == 2 else float("nan"),
            "decode_s": 0.1,
            "sigma_decoding_mm": 0.17,
            "sigma_cal_mm": 0.1,
            "sigma_mm": 0.2,
            "calibration_share": 0.25,
        }
        methods.append(Method(name, "gray", f"/scans/{name}", cloud, away, numbers, {"step": 2}, ("look here",)))
    verdict = {"grade": "usable", "reasons": [{"fault": "few <views>", "view": "", "remedy": "take more"}]}
    return Comparison(
        tuple(methods), paper_rig(), "rms_mm", "a plate", "by hand", verdict, SETTINGS, 2, None, {"/bad": "/bad is bad"}
    )


def test_the_table_and_the_files_hold_the_same_numbers(comparison: Comparison):
    table = methods_table(comparison)
    assert [row[0] for row in table.rows] == ["dense one", "sparse"]
    shown = {c: [row[i] for row in table.rows] for i, c in enumerate(table.columns)}
    assert shown["patterns"] == ["28", "1"]
    assert shown["accuracy (rms), mm"] == ["0.100", "0.600"]
    assert shown["complete, %"] == ["50.0", "50.0"]
    assert shown["roughness / limit"] == ["2.00", "–"]
    read = list(csv.DictReader(io.StringIO(comparison_csv(comparison))))
    told = json.loads(json.dumps(comparison_json(comparison), allow_nan=False))
    for method, line, row in zip(comparison.methods, read, told["methods"], strict=True):
        assert (line["method"], row["name"]) == (method.name, method.name)
        for name, value in method.numbers.items():
            assert row[name] == (None if np.isnan(value) else pytest.approx(value))
            assert line[name] == ("" if np.isnan(value) else pytest.approx(value, abs=1e-8)) or float(
                line[name]
            ) == pytest.approx(value)
    assert told["verdict"]["grade"] == "usable" and told["cores"] == 2
    assert told["failed"] == [{"folder": "/bad", "reason": "/bad is bad"}]


def test_every_number_says_its_unit():
    units = ("_mm", "_s", "_deg", "_share", "_ratio", "patterns", "points", "f_score")
    assert all(name.endswith(units) for name in COLUMNS)


def test_the_calibrations_part_stands_beside_the_methods_own(comparison: Comparison):
    table = calibration_table(comparison)
    assert table.columns[1:] == (
        "own sigma, mm",
        "sigma of the calibration, mm",
        "sigma of both, mm",
        "calibration's share of the variance, %",
    )
    assert table.rows[0][1:] == ("0.170", "0.100", "0.200", "25")
    bare = replace(
        comparison, methods=tuple(replace(m, numbers={"patterns": 1.0, "points": 3.0}) for m in comparison.methods)
    )
    assert not calibration_table(bare).rows and "no covariance" in calibration_table(bare).missing


def test_what_was_not_measured_has_no_column(comparison: Comparison):
    assert "95 %, mm" not in methods_table(comparison).columns
    assert "p95_mm" not in comparison_csv(comparison)


def decoded(png: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR).astype(float)


def test_figures_share_their_scale_and_the_worse_method_looks_worse(comparison: Comparison):
    sections = comparison_sections(comparison)
    panels = {p.name: p for s in sections for p in s.panels}
    kinds = ("cloud", "error-cloud", "error-map")
    names = {f"{kind}-{name}" for kind in kinds for name in ("dense-one", "sparse")}
    assert set(panels) == names | {"trade-off", "section", "section-part"}
    assert all(p.png is not None for p in panels.values())
    dense, sparse = (decoded(panels[f"error-map-{n}"].png) for n in ("dense-one", "sparse"))
    inside = np.s_[120:-120, 200:650]

    def strong(picture: np.ndarray) -> float:
        """Share of the coloured pixels that are far from grey."""
        spread = np.ptp(picture[inside], axis=-1)
        return (spread > 100).sum() / (picture[inside].min(axis=-1) < 250).sum()

    assert strong(sparse) > 3 * strong(dense)


def test_one_colour_scale_holds_most_points_of_all_methods(comparison: Comparison):
    values, scale = _values(comparison)
    pooled = np.abs(np.concatenate(values))
    assert (pooled <= scale.high).mean() == pytest.approx(0.95, abs=0.01)
    assert scale.low == -scale.high and [scale.extend(v) for v in values] == ["neither", "both"]


def test_without_a_distance_the_stated_sigma_colours_the_points(comparison: Comparison):
    blind = tuple(replace(m, away_mm=np.full(len(m.cloud), np.nan)) for m in comparison.methods)
    sections = comparison_sections(replace(comparison, methods=blind))
    assert any("stated sigma" in s.note for s in sections)
    assert all(p.png is not None for s in sections for p in s.panels)


def test_few_points_make_no_section(comparison: Comparison):
    few = tuple(replace(m, cloud=m.cloud.select(np.arange(5)), away_mm=m.away_mm[:5]) for m in comparison.methods)
    section = comparison_sections(replace(comparison, methods=few))[-1]
    assert [p.png for p in section.panels] == [None]


def test_clouds_in_one_frame_have_one_scale(comparison: Comparison):
    whole = comparison.methods[0].cloud
    part = whole.select(whole.xyz[:, 0] < np.median(whole.xyz[:, 0]))
    views = (View("", 0.0, 0.0),)
    alone, framed = (draw_cloud(part, (640, 480), views, frame_xyz=f) for f in (None, whole.xyz))
    full = draw_cloud(whole, (640, 480), views)
    left, right = np.s_[60:400, 100:300], np.s_[60:400, 350:560]
    assert np.abs(full[left].astype(int) - framed[left]).mean() < 5
    assert np.abs(full[right].astype(int) - framed[right]).mean() > 20
    assert (
        np.abs(full[right].astype(int) - alone[right]).mean() < np.abs(full[right].astype(int) - framed[right]).mean()
    )


class Page(HTMLParser):
    def __init__(self, html: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.tags: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for name, value in attrs if name in ("src", "href", "srcset")]


def test_the_page_stands_alone(comparison: Comparison, monkeypatch: pytest.MonkeyPatch):
    report = comparison_report(comparison, "two <methods>")
    page = Page(report.html)
    assert len(page.links) == len(report.pictures)
    assert all(link.startswith("data:image/png;base64,") for link in page.links)
    assert not {"script", "link", "iframe"} & set(page.tags)
    assert "url(" not in report.html and "@import" not in report.html
    for text in (
        "Comparison of 2 methods",
        "two &lt;methods&gt;",
        "Calibration: usable",
        "Few &lt;views&gt;.",
        "Take more.",
        "By hand.",
        "/bad is bad.",
        "dense one: look here.",
        "2 cores",
        "within 4 mm",
        "step = 2",
    ):
        assert text in report.html, text
    monkeypatch.setattr("slkit.report.comparison_figures.comparison_sections", lambda comparison: ())
    unjudged = comparison_report(replace(comparison, verdict={}, failed={}))
    assert "Calibration without a verdict" in unjudged.html and "Not compared" not in unjudged.html

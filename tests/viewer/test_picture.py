"""Pictures of recordings without a screen: they show the content of the recording in its layout."""

import copy
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from matplotlib.figure import Figure

from klute_sim.errors import InputError, KluteSimWarning
from klute_sim.viewer import chart, heatmap, stream
from klute_sim.viewer.picture import picture, render, render_scene, rrd_reader
from klute_sim.viewer.picture.rrd_reader import Container, Entity, RrdContents, View
from klute_sim.viewer.stream import BLUE, RED, SeriesLine
from tests.command_line import run

rr = pytest.importorskip("rerun")

TIME = np.linspace(0.0, 2.0, 21)
LOOP = chart.Chart(
    "loop",
    "length [mm]",
    "force [N]",
    (
        chart.ChartCurve("round", BLUE, np.cos(np.pi * TIME), np.sin(np.pi * TIME)),
        chart.ChartCurve("far", RED, np.array([-4.0, 4.0]), np.array([0.0, 2.0])),
    ),
)
MAP = heatmap.Heatmap(
    "map", "time [s]", np.linspace(0.0, 2.0, 3), ("a", "b"), np.array([[0.0, 4.0], [np.nan, 2.0]]), 4.0, "sd"
)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    import rerun.blueprint as rrb

    def layout() -> Any:
        words = stream.build_text_view("page", "page")
        left = rrb.Vertical(
            stream.build_plot_view("wave [N]", ["wave"]), chart.build_view(LOOP, "loop"), row_shares=[3, 1]
        )
        tabs = rrb.Tabs(heatmap.build_view(MAP, "map"), words)
        body = rrb.Spatial3DView(origin="world", name="body")
        return stream.build_window_blueprint(rrb.Horizontal(left, tabs, body, column_shares=[2, 1, 1]), "time")

    path = tmp_path_factory.mktemp("picture") / "r.rrd"
    with stream.open_recording(path, "test", ["one"], layout) as out:
        axis = rr.TimeColumn("time", duration=TIME)
        stream.send_lines(out, axis, [SeriesLine("wave", "a wave", RED, 2.0, np.sin(TIME))])
        chart.log_chart(out, LOOP)
        chart.log_marker(out, LOOP, axis, np.cos(np.pi * TIME), np.sin(np.pi * TIME))
        heatmap.log_heatmap(out, MAP)
        stream.log_text(
            out, "page", "# Title\n\nSome words.\n\n" + stream.format_markdown_table(["name", "value"], [["x", 1.25]])
        )
        turn = rr.Transform3D(translation=[0.0, 0.0, 0.5], quaternion=[0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)])
        out.log("world/bone", turn, static=True)
        out.log("world/bone/rod", rr.Capsules3D(lengths=[0.4], radii=[0.05], colors=[RED]), static=True)
    return path


@pytest.fixture(scope="module")
def contents(file: Path) -> RrdContents:
    return rrd_reader.read_rrd(file)


def get_view(contents: RrdContents, name: str) -> View:
    return next(view for view in rrd_reader.iter_views(contents.root) if view.name == name)


def get_axis(contents: RrdContents, name: str, cursor: float = 0.5) -> Any:
    return picture.build_view_figure(contents, get_view(contents, name), cursor).axes[0]


def test_layout_reads_back(contents: RrdContents) -> None:
    assert contents.timeline == "time"
    assert isinstance(contents.root, Container)
    assert (contents.root.kind, contents.root.relative_sizes) == ("row", (2.0, 1.0, 1.0))
    left, tabs, body = contents.root.children
    assert isinstance(left, Container)
    assert isinstance(tabs, Container)
    assert (left.kind, left.relative_sizes, tabs.kind) == ("column", (3.0, 1.0), "tabs")
    assert [each.name for each in rrd_reader.iter_views(contents.root)] == ["wave [N]", "loop", "map", "page", "body"]
    assert [each.kind for each in (*left.children, body)] == ["TimeSeries", "2D", "3D"]  # type: ignore[union-attr]


def test_line_plot_shows_values_and_cursor(contents: RrdContents) -> None:
    axis = get_axis(contents, "wave [N]")
    line, cursor = axis.lines
    assert line.get_xdata() == pytest.approx(TIME, abs=1e-9)
    assert np.array_equal(line.get_ydata(), np.sin(TIME))
    assert line.get_label() == "a wave"
    assert line.get_color()[:3] == pytest.approx(np.array(RED) / 255.0)
    assert set(cursor.get_xdata()) == {0.5}


@pytest.mark.parametrize(("height", "is_one_row"), [(1.5, True), (3.0, False)])
def test_legend_of_a_low_view_has_one_row(height: float, is_one_row: bool, contents: RrdContents) -> None:
    axis = Figure(figsize=(4.0, height)).subplots()
    wave, other = contents.entities["wave"], copy.copy(contents.entities["wave"])
    other.static = {**wave.static, "names": ["another wave"]}
    render.draw_series(axis, get_view(contents, "wave [N]"), {"wave": wave, "other": other}, "time", 0.5)
    axis.figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in axis.get_legend().get_texts()]
    assert (abs(boxes[0].y0 - boxes[1].y0) < 3.0) == is_one_row


def test_long_title_is_wrapped(contents: RrdContents) -> None:
    view = get_view(contents, "wave [N]")._replace(name="word " * 30)
    assert "\n" in picture.build_view_figure(contents, view, 0.5).axes[0].get_title(loc="left")


def test_long_label_of_a_plane_is_wrapped(contents: RrdContents) -> None:
    label = Entity()
    label.archetypes, label.static = {"Points2D"}, {"positions": [[0.0, 0.0]], "labels": ["word " * 20]}
    axis = Figure().subplots()
    render.draw_plane(axis, get_view(contents, "loop"), {"label": label}, "time", 0.5)
    lines = axis.texts[0].get_text().splitlines()
    assert len(lines) > 1
    assert max(map(len, lines)) <= render.MAX_LABEL_CHARS


def test_chart_is_to_scale_with_the_marker_at_the_cursor(contents: RrdContents) -> None:
    axis = get_axis(contents, "loop", cursor=0.5)
    labels = [(text.get_text(), *text.get_position()) for text in axis.texts]
    assert {"round", "far", "across: length [mm], up: force [N]"} <= {name for name, _, _ in labels}
    tick_positions = {name: x for name, x, y in labels if chart.FRAME_HEIGHT < y < chart.FRAME_HEIGHT + 10.0}
    assert tick_positions["4"] - tick_positions["2"] == pytest.approx(2.0 * chart.FRAME_WIDTH / 8.8, rel=0.01)
    (marker,) = axis.collections[-1].get_offsets()
    # After 0.5 s the circle is at its top: length 0, and force 1 N on an axis from -1.15 to 2.15 N.
    assert marker[0] == pytest.approx(tick_positions["0"], abs=0.01)
    assert marker[1] == pytest.approx(chart.FRAME_HEIGHT * 1.15 / 3.3, abs=0.01)


def test_heatmap_colours_match_its_values(contents: RrdContents) -> None:
    pixels = render.decode_image(get_view(contents, "map").select_entities(contents.entities)["map/map"])
    height, width = pixels.shape[:2]
    rows, columns = (height // 4, 3 * height // 4), (width // 4, 3 * width // 4)
    corners = [tuple(pixels[y, x]) for y in rows for x in columns]
    expected = [
        heatmap.COLOUR_SCALE[0],
        heatmap.COLOUR_SCALE[-1],
        heatmap.MISSING_VALUE_COLOUR,
        heatmap.COLOUR_SCALE[2],
    ]
    assert corners == [tuple(colour) for colour in expected]
    (image,) = get_axis(contents, "map").images
    assert image.get_extent() == [0.0, chart.FRAME_WIDTH, chart.FRAME_HEIGHT, 0.0]


def test_text_is_drawn_without_markup(contents: RrdContents) -> None:
    lines = [text.get_text() for text in get_axis(contents, "page").texts]
    assert lines[0] == "Title"
    assert "Some words." in lines
    assert lines.index("x     1.25") == lines.index("name  value") + 1


def test_body_is_drawn_at_its_pose(contents: RrdContents) -> None:
    (rod,) = get_axis(contents, "body").patches
    # A rotation by 90 degrees about y turns the vertical rod forward.
    (left, low), (right, high) = rod.get_xy().min(axis=0), rod.get_xy().max(axis=0)
    assert (left, right, low, high) == pytest.approx((-0.05, 0.45, 0.45, 0.55), abs=1e-6)


def test_outline_of_rounded_shapes_is_the_hull_of_circles() -> None:
    shape = render_scene.compute_outline(np.array([[0.0, 0.0], [1.0, 0.0]]), 0.1)
    assert shape.min(axis=0) == pytest.approx([-0.1, -0.1])
    assert shape.max(axis=0) == pytest.approx([1.1, 0.1])


def test_value_is_the_last_one_before_the_cursor() -> None:
    entity = Entity()
    entity.rows["x"], entity.times["time"] = ["a", "b", "c"], [np.array([0.0, 1.0, 2.0])]
    assert [entity.get_value("x", "time", time) for time in (-1.0, 0.5, 1.0, 9.0)] == ["a", "a", "b", "c"]
    entity.static["y"] = ["always"]
    assert entity.get_value("y", "time", 0.5) == ["always"]


def test_pictures_of_window_and_views_are_written(file: Path, tmp_path: Path) -> None:
    completed = run("view", str(file), "--picture", str(tmp_path / "window.png"), "--at", "0.5")
    assert completed.returncode == 0, completed.stderr
    assert completed.stdout.split() == [str(tmp_path / "window.png")]
    pixels = matplotlib.image.imread(tmp_path / "window.png")
    assert pixels.shape[1] == round(picture.WINDOW_SIZE_IN[0] * picture.DPI)
    assert pixels[..., :3].std() > 0.03
    completed = run("view", str(file), "--picture", str(tmp_path / "views"))
    names = ["01-wave.png", "02-loop.png", "03-map.png", "04-page.png", "05-body.png"]
    assert [Path(line).name for line in completed.stdout.splitlines()] == names
    assert sorted(path.name for path in (tmp_path / "views").iterdir()) == names


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--at", "1"], "--at sets the cursor of a picture: add --picture"),
        (["--web", "--picture", "p.png"], "--web and --picture exclude each other"),
        (["--picture", ""], "the path is empty"),
    ],
)
def test_incompatible_options_are_refused_in_one_sentence(arguments: list[str], message: str, file: Path) -> None:
    completed = run("view", str(file), *arguments)
    assert completed.returncode == 2
    assert message in completed.stderr
    assert len(completed.stderr.strip().splitlines()) == 1


def test_foreign_recording_is_refused_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "bad.rrd").write_bytes(b"nonsense")
    with pytest.raises(InputError, match="cannot be read"):
        rrd_reader.read_rrd(tmp_path / "bad.rrd")
    without_layout = rr.RecordingStream("else", recording_id="1")
    without_layout.save(tmp_path / "without_layout.rrd")
    without_layout.log("x", rr.Scalars(1.0))
    without_layout.disconnect()
    with pytest.raises(InputError, match="has no layout"):
        rrd_reader.read_rrd(tmp_path / "without_layout.rrd")


def test_unsupported_picture_formats_are_refused(tmp_path: Path) -> None:
    for name in ("q.jpg", "q.PDF"):
        with pytest.raises(
            InputError, match=r"pictures are PNG files; give a file name that ends in \.png, or a folder"
        ):
            picture.save_pictures(tmp_path / "none.rrd", tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_cursor_begins_in_what_the_curves_show(
    file: Path, contents: RrdContents, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert picture._find_shown_span(contents) == pytest.approx((0.0, 2.0))
    view = get_view(contents, "wave [N]")
    assert picture._find_shown_span(contents._replace(root=view._replace(span=(0.2, 0.4)))) == (0.2, 0.4)
    cursors = []
    monkeypatch.setattr(picture, "build_window_figure", lambda _, cursor: cursors.append(cursor) or Figure())
    picture.save_pictures(file, tmp_path / "window.png")
    assert cursors == [pytest.approx(1.0)]
    with pytest.warns(KluteSimWarning, match="the curves show 0 to 2 on the timeline 'time'; the cursor, at 2.9, is"):
        picture.save_pictures(file, tmp_path / "window.png", 2.9)


def test_only_values_on_the_selected_timeline_are_read(tmp_path: Path) -> None:
    def layout() -> Any:
        return stream.build_window_blueprint(stream.build_plot_view("wave", ["wave"]), "count [%]", frame_rate=50.0)

    with stream.open_recording(tmp_path / "r.rrd", "test", ["two"], layout) as out:
        for axis in (rr.TimeColumn("time", duration=TIME), rr.TimeColumn("count [%]", sequence=np.arange(21))):
            out.send_columns("wave", indexes=[axis], columns=rr.Scalars.columns(scalars=np.sin(TIME)))
    contents = rrd_reader.read_rrd(tmp_path / "r.rrd")
    (line, _) = get_axis(contents, "wave", 5.0).lines
    assert np.array_equal(line.get_xdata(), np.arange(21))
    assert np.array_equal(line.get_ydata(), np.sin(TIME))


@pytest.mark.parametrize(
    ("name", "slug"),
    [
        ("work loop of the ankle (counter-clockwise: positive net work)", "work-loop-of-the-ankle"),
        ("leg (tendon: red at peak force)", "leg"),
        ("ground reaction, vertical and forward, of both legs [N]", "ground-reaction-vertical-and-forward-of"),
        ("(all)", "view"),
    ],
)
def test_names_of_pictures_end_between_words(name: str, slug: str) -> None:
    assert picture._slugify(name) == slug

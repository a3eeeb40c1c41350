"""The rerun viewer: on this machine only, without statistics, and one sentence when it fails."""

import sys
from pathlib import Path

import pytest

from klute_sim.errors import KluteSimError, MissingExtraError
from klute_sim.viewer import window


@pytest.fixture(autouse=True)
def screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":0")


def recording(folder: Path) -> Path:
    (folder / "r.rrd").touch()
    return folder / "r.rrd"


def test_viewer_needs_rerun(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtraError, match=r"viewer .* pip install '\.\[rerun\]'"):
        window.open_viewer(recording(tmp_path))


@pytest.mark.parametrize("web_port", [None, 5])
def test_viewer_listens_on_the_loopback_address_only(web_port: int | None) -> None:
    command = window.build_viewer_command("rerun", Path("r.rrd"), port=4, web_port=web_port)
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert ("--serve-web" in command) == (web_port is not None)
    assert command[-1] == "r.rrd"


def test_usage_statistics_are_disabled_without_changing_settings(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert window.disable_statistics({"HOME": "h", "FORCE_RERUN_ANALYTICS": "1"}) == {"HOME": "h", "CI": "1"}
    assert window.format_web_address(4, 5).endswith("url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A4%2Fproxy&notebook=1")
    (tmp_path / "rerun").write_text(f"#!/bin/sh\necho CI=$CI LOG=$RUST_LOG $@ >> {tmp_path}/calls\n")
    (tmp_path / "rerun").chmod(0o755)
    monkeypatch.delenv("CI", raising=False)
    monkeypatch.setattr(window, "find_viewer_program", lambda: str(tmp_path / "rerun"))
    window.open_viewer(recording(tmp_path))
    (call,) = (tmp_path / "calls").read_text().splitlines()
    assert call.startswith("CI=1 LOG=warn --bind 127.0.0.1")


def test_failing_viewer_is_reported_in_one_sentence(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(window, "find_viewer_program", lambda: "false")
    with pytest.raises(KluteSimError, match="ended with code 1"):
        window.open_viewer(recording(tmp_path))


def test_viewer_is_not_started_without_a_display(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    started: list[object] = []
    monkeypatch.setattr(window, "find_viewer_program", lambda: "true")
    monkeypatch.setattr(window.subprocess, "run", lambda *args, **kwargs: started.append(args))
    monkeypatch.setattr(window.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(KluteSimError, match=r"needs a display .* try --web or --picture"):
        window.open_viewer(recording(tmp_path))
    assert not started
    assert window.has_display("linux", {"WAYLAND_DISPLAY": "wayland-0"})
    assert window.has_display("darwin", {})

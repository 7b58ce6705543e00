"""`bake render SCENE --live` as a user calls it: the page, its stop button, the address, what is refused."""

import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

import renderers
from bakery.cli import live as command_live
from bakery.cli import status_of
from bakery.report import served
from renderers.pictures import live
from tests.browser import CHROMIUM, Page
from tests.conftest import ROOT
from tests.exr import layers

SCENE = """\
bakery_scene: 2
name: mist
scene: {mitsuba: room.xml, unit: 1 m}
stop: {samples: 32, noise: 1e-4}
film: {width: 24, height: 18}
materials:
  - {where: everywhere, recipe: mist.yaml}
"""
MIST = """\
bakery: 1
name: mist
wavelengths: rgb
medium: {albedo: [0.9, 0.8, 0.7], mean_free_path: "[90, 80, 70] cm", phase: {type: hg, g: 0.7}}
"""
XML = """<scene version="3.0.0">
<sensor type="perspective"><float name="fov" value="30"/><transform name="to_world"><lookat origin="0, -0.5, 0.15"
target="0, 0, 0.03" up="0, 0, 1"/></transform><film type="hdrfilm"/></sensor>
<shape type="rectangle" id="floor"><bsdf type="diffuse"/></shape>
<shape type="rectangle" id="panel"><transform name="to_world"><scale value="0.2"/><rotate x="1" angle="180"/><translate z="0.5"/>
</transform><emitter type="area"><rgb name="radiance" value="3 3 3"/></emitter></shape></scene>"""
LONG = ("--set", "stop.samples=1000000")  # nobody waits for its end


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("live")
    for name, text in {"mist.scene.yaml": SCENE, "mist.yaml": MIST, "room.xml": XML}.items():
        (folder / name).write_text(text)
    return folder


@pytest.fixture
def addresses(monkeypatch):
    """Lines of `bake render --live`, as they come."""
    lines: list[str] = []
    monkeypatch.setattr(command_live, "remark", lines.append)
    return lines


@pytest.fixture
def call(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("BAKERY_CACHE", str(folder / "cache"))

    def called(*arguments):
        status = status_of(["render", "mist.scene.yaml", "--json", *arguments])
        output = capsys.readouterr()
        return status, json.loads(output.out) if output.out.startswith("{") else None, output.err

    return called


def request(address, path, method="GET"):
    _, _, host, token, _ = address.split("/")
    connection = http.client.HTTPConnection(host, timeout=30)
    connection.request(method, f"/{token}/{path}")
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, content


def in_the_background(lines, work):
    """Calls work(address) once there is a page; what it gives comes into the list."""
    given: list = []

    def follow():
        while not lines:
            time.sleep(0.01)
        given.append(work(lines[0].removeprefix("live: ")))

    thread = threading.Thread(target=follow, daemon=True)
    thread.start()
    return thread, given


def looked_at(address):
    """As a page does, for which the server waits at the end."""
    state, status = json.loads(request(address, "state?page=1")[1]), request(address, "layer/picture.png")[0]
    request(address, "kept?page=1", "POST")
    return state, status


@pytest.mark.slow
def test_the_same_bytes_with_and_without_a_page(call, addresses, folder):
    assert call("-o", "alone.png")[0] == 3
    thread, states = in_the_background(addresses, looked_at)
    status, report, _ = call("-o", "seen.png", "--live")
    thread.join(30)
    assert status == 3 and report["stopped_by"] == "samples" and not report["stopped"]
    assert states[0][0]["phase"] in ("preparing", "passes", "writing", "over")
    for ending in ("png", "exr"):
        assert (folder / f"alone.{ending}").read_bytes() == (folder / f"seen.{ending}").read_bytes()


def stopped_early(address):
    """Looks at the picture, stops the render, and leaves."""
    while (state := json.loads(request(address, "state?page=1")[1]))["phase"] in ("preparing", "passes") and not state["layers"]:
        time.sleep(0.01)
    names = [layer["name"] for layer in state["layers"]]
    frames = {name: request(address, f"layer/{name}.png") for name in names}
    request(address, "stop", "POST")
    while json.loads(request(address, "state?page=1")[1])["phase"] != "over":
        time.sleep(0.01)
    last = json.loads(request(address, "state?page=1")[1]), request(address, "layer/picture.png")[1]
    request(address, "kept?page=1", "POST")
    return names, frames, last


@pytest.mark.slow
def test_a_page_stops_the_render(call, addresses, folder):
    """Whole files, the last picture for the page, status 3 where the noise that was asked for is missed; a draft only tells."""
    thread, given = in_the_background(addresses, stopped_early)
    status, report, error = call("-o", "stopped.png", "--live", *LONG)
    thread.join(30)
    names, frames, (state, png) = given[0]
    assert status == 3 and report["stopped"] and report["stopped_by"] == "request"
    assert report["missed"][0].startswith("a request ended the passes") and "a request ended the passes" in error
    assert "picture" in names and "noise" in names and "order1" in names and "light.panel" in names
    assert all(code == 200 and content.startswith(b"\x89PNG") for code, content in frames.values())
    assert state["report"]["files"] == report["files"] and state["samples"] == report["samples"]
    from PIL import Image

    assert np.array_equal(np.array(Image.open(folder / "stopped.png")), np.array(Image.open(__import__("io").BytesIO(png))))
    assert set("RGB") <= layers(folder / "stopped.exr").keys()
    status, later, _ = call("-o", "stopped.png", "--resume", "--set", f"stop.samples={report['samples'] + 8}")
    assert status == 3 and later["samples"] >= report["samples"] + 8
    addresses.clear()
    thread, given = in_the_background(addresses, stopped_early)
    assert call("-o", "stopped.png", "--live", "--quality", "draft", "--no-denoise", *LONG)[0] == 0
    thread.join(30)


def test_what_has_no_passes_is_refused(call, folder, monkeypatch, capsys):
    (folder / "fog.yaml").write_text("bakery_scene: 2\nname: fog\nrecipe: mist.yaml\npicture: {mitsuba: room.xml}\nfog: {}\n")
    for source, words in (("fog.yaml", "makes its picture at once"), ("room.xml", "is no scene (.yaml)"), ("x.h5", "")):
        (folder / "x.h5").write_bytes(b"")
        assert status_of(["render", source, "--live"]) == 2
        assert words in capsys.readouterr().err
        assert words == "" or not list(folder.glob("fog.png"))
    with pytest.raises(live.UsageError, match="makes its picture at once"):
        renderers.live("fog.yaml")


@pytest.mark.slow
def test_a_port_that_cannot_be_had(call, addresses):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        status, report, _ = call("-o", "port.png", "--live-port", str(port))
    assert status == 3 and report["samples"] == 32  # two passes of 16
    assert len(addresses) == 1
    assert addresses[0].startswith(f"--live: port {port} of 127.0.0.1 is not available (Address already in use)")


MIST_SCENE = SimpleNamespace(values=SimpleNamespace(name="mist"), rules=SimpleNamespace(RESUMES=True))


def test_who_gets_a_browser(monkeypatch, addresses):
    """Somebody at a terminal who has a screen; where none opens, a line."""
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or len(opened) > 1)
    for terminal, display, browser, expected in ((True, ":0", True, 1), (True, ":0", True, 1), (False, ":0", True, 0),
                                                 (True, "", True, 0), (True, ":0", False, 0)):
        before = len(opened)
        monkeypatch.setattr("sys.stderr.isatty", lambda terminal=terminal: terminal, raising=False)
        monkeypatch.setattr("sys.platform", "linux")
        monkeypatch.setenv("DISPLAY", display)
        monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
        with command_live.shown(MIST_SCENE, "x.yaml", 0, browser):
            pass
        assert len(opened) - before == expected
    assert [line.startswith("live: http://127.0.0.1:") for line in addresses].count(True) == 5
    assert [line for line in addresses if "no browser" in line] == [addresses[1]]


@pytest.mark.slow
def test_pictures_of_a_scene(folder, monkeypatch):
    """The last one is what is written; the passes are those of `bake render`."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("BAKERY_CACHE", str(folder / "cache"))
    shown = list(renderers.live("mist.scene.yaml", "python.png", every=0))
    assert len(shown) >= 2 and [picture.samples for picture in shown] == sorted(picture.samples for picture in shown)
    assert shown[-1].report["files"] == ["python.png", "python.exr"] and shown[-1].samples == 32
    found = layers(folder / "python.exr")
    assert np.allclose(shown[-1].rgb[..., 1], found["G"], rtol=1e-6) and {"order0", "light.panel"} <= shown[-1].layers.keys()


@pytest.mark.slow
def test_the_python_of_the_docs(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("BAKERY_CACHE", str(folder / "cache"))
    (folder / "lamp.yaml").write_text(SCENE.replace("name: mist", "name: lamp"))
    (snippet,) = re.findall(r"^```python\n(.*?)^```$", (ROOT / "docs" / "live.md").read_text(), re.MULTILINE | re.DOTALL)
    exec(compile(snippet, "docs/live.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert lines[-2].startswith("<Picture 24 x 18, paths, 32 samples a pixel, noise ") and lines[-1] == "['lamp.png', 'lamp.exr']"


def process(folder, *arguments):
    process = subprocess.Popen([sys.executable, "-m", "bakery", "render", "mist.scene.yaml", "--live", *arguments], cwd=folder,
                               env={**os.environ, "PYTHONPATH": str(ROOT), "BAKERY_CACHE": str(folder / "cache")}, text=True,
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    for line in process.stderr:
        if found := re.search(r"live: (http://\S+)", line):
            return process, found[1]
    raise AssertionError("no address")


@pytest.mark.slow
def test_an_interruption_is_as_ever(folder):
    """Files whole, status 130, no waiting for a page that is not there; --quiet has the address."""
    running, address = process(folder, "-o", "interrupted.png", "--quiet", *LONG)
    while not json.loads(request(address, "state")[1])["layers"]:
        time.sleep(0.05)
    running.send_signal(signal.SIGINT)
    _, error = running.communicate(timeout=60)
    assert running.returncode == 130 and "--resume goes on with it" in error
    assert set("RGB") <= layers(folder / "interrupted.exr").keys()


KEPT = "document.body.dataset.kept == 'yes'"
LAYERS = "[...document.querySelectorAll('#layers input')].map(one => one.value).join()"
COLOURS = "[...document.querySelector('canvas').getContext('2d').getImageData(0, 0, 24, 18).data]"
MIDDLE = "(({x, y, width, height}) => [x + width / 2, y + height / 2])(document.querySelector('#view').getBoundingClientRect())"


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: the page is not tried")
def test_the_page_in_a_browser(folder, tmp_path):
    """It gets better, has layers, zoom and values, stops the render, and has all of it when the process is gone."""
    running, address = process(folder, "-o", "page.png", *LONG)
    with Page(address) as shown:
        shown.until("document.querySelector('#empty').hidden")
        first = int(shown.value("document.querySelector('#samples').firstChild.textContent"))
        shown.until(f"Number(document.querySelector('#samples').firstChild.textContent) > {first}")
        assert shown.value(LAYERS) == "picture,noise,order0,order1,order2,orders,light.panel"
        assert shown.value("[document.querySelector('canvas').width, document.querySelector('canvas').height]") == [24, 18]
        assert shown.value("document.querySelector('#view').classList.contains('large')")  # pixels as squares
        shown.until("document.querySelector('#noise').textContent.includes('% of 0.01')")
        x, y = shown.value(MIDDLE)
        shown.point(x + 1, y + 1)
        readout = shown.value("document.querySelector('#readout').textContent")
        assert readout.startswith("pixel 12, 9\nlinear R ") and "±" in readout
        before = shown.value("document.querySelector('canvas').style.transform")
        shown.wheel(x, y, -200)
        shown.until(f"document.querySelector('canvas').style.transform != '{before}'")
        shown.point(x + 1, y + 1)  # the pointer stays where it was in the picture
        assert shown.value("document.querySelector('#readout').textContent").startswith("pixel 12, 9\n")
        assert not shown.value("document.querySelector('#pixel').hidden")
        shown.value("document.querySelector('#view').focus()")
        shown.key("0", 48)
        assert shown.value("document.querySelector('canvas').style.transform") == before
        shown.value("document.querySelector('#layers input[value=noise]').click()")
        shown.until("document.querySelector('#words').textContent.startsWith('noise: standard error')")
        shown.value("document.querySelector('#layers input[value=picture]').click()")
        shown.value("document.querySelector('#stop').click()")
        shown.until(KEPT)
        _, error = running.communicate(timeout=60)
        assert running.returncode == 3 and "a request ended the passes" in error
        # the process is gone
        assert shown.value("document.querySelector('#phase').textContent") == "Done: stopped"
        assert "page.png" in shown.value("document.querySelector('#text').textContent")
        from PIL import Image

        written = Image.open(folder / "page.png").convert("RGB")
        assert np.array_equal(np.reshape(shown.value(COLOURS), (18, 24, 4))[..., :3], np.array(written))
        shown.value("document.querySelector('#layers input[value=order1]').click()")
        shown.point(x + 1, y + 1)
        value = layers(folder / "page.exr")["order1.R"][9, 12]
        readout = shown.value("document.querySelector('#readout').textContent")
        assert float(re.search(r"pixel 12, 9\nlinear R ([\d.e-]+)", readout)[1]) == pytest.approx(value, rel=6e-3)
        assert shown.said == []


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: the page is not tried")
def test_the_page_on_a_phone_whose_render_is_killed(folder):
    """Nothing is wider than the screen, dark where the reader's system is, and the page says that nobody answers any more."""
    running, address = process(folder, "-o", "killed.png", *LONG)
    with Page(address, width=390, height=844, dark=True) as shown:
        shown.until("document.querySelector('#empty').hidden")
        assert shown.value("document.documentElement.scrollWidth") == 390
        assert shown.value("getComputedStyle(document.body).backgroundColor") == "rgb(20, 24, 29)" and shown.said == []
        running.kill()
        running.communicate()
        shown.until("document.querySelector('#phase').textContent == 'No connection'")
        assert shown.value("document.querySelector('#stop').hidden") and shown.value("document.querySelector('#empty').hidden")
    assert not (folder / "killed.png").exists()


def test_the_server_is_of_this_machine_alone():
    assert served.HOST == "127.0.0.1"

"""The viewer in a real browser: it loads, grasps change, the slider moves, the console is clean."""

import json
import re
import shutil
import signal
import subprocess
import sys
from contextlib import contextmanager

import numpy as np
import pytest
from live_node import LiveNode, NodeClient, plan_request
from PIL import Image
from playwright import sync_api

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(
    BROWSER is None, reason="no Chromium here, and `make test` may not install it"
)
# Without a graphics card WebGL is drawn by software.
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


@contextmanager
def viewer(*arguments):
    """Run the command; yields its address, and ends it by Ctrl-C, after which it must say 0."""
    command = [sys.executable, "-m", "gpis_grasp_planner.cli.main", "view", *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        address = process.stdout.readline().split()[0]
        assert address.startswith("http://127.0.0.1:")
        yield address
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0
        process.stdout.close()


@contextmanager
def page_at(address):
    """A page that has been loaded; at its end nothing may have been wrong in the console."""
    wrong = []
    with sync_api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=BROWSER, args=FLAGS)
        page = browser.new_page(viewport={"width": 1200, "height": 750})
        page.on("console", lambda m: wrong.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.goto(address)
        page.wait_for_selector("canvas")
        page.get_by_text("phase:").wait_for()
        yield page
        browser.close()
    assert wrong == []


def picture(page, path):
    """What the page shows left of its panel, once it does not change any more."""
    before = None
    for _ in range(40):
        page.wait_for_timeout(500)
        page.screenshot(path=path)
        now = np.asarray(Image.open(path).convert("RGB")).astype(int)[200:, :850]
        if before is not None and now.std() > 5.0 and np.array_equal(now, before):
            return now
        before = now
    raise AssertionError("the page has no still picture after 20 s")


def test_grasps_change_and_the_slider_moves(mug_document, tmp_path):
    with viewer(mug_document, "--port", "8241") as address, page_at(address) as page:
        closed = picture(page, tmp_path / "closed.png")
        moment = page.locator("input[inputmode], input[type=text]").last
        moment.fill("0")
        moment.press("Enter")
        page.get_by_text("phase: approach").wait_for()
        opened = picture(page, tmp_path / "open.png")
        assert (np.abs(opened - closed).max(axis=2) > 30).mean() > 0.01
        choice = page.locator("input[aria-haspopup=listbox]").last
        first = choice.input_value()
        assert first.startswith("0: epsilon")
        choice.click()
        page.get_by_role("option").nth(1).click()
        page.get_by_text("phase: closing").wait_for()
        assert choice.input_value().startswith("1: epsilon")
        other = picture(page, tmp_path / "other.png")
        assert (np.abs(other - closed).max(axis=2) > 30).mean() > 0.005


def test_lost_palms_are_points_with_a_legend(mug_document, tmp_path):
    lost = json.loads(mug_document.read_text())["lost_palms"]
    with viewer(mug_document, "--port", "8251") as address, page_at(address) as page:
        legend = page.locator("div", has_text="some of each cause").last
        assert legend.locator("span").count() == len(lost) > 3
        for entry in lost:
            assert entry["cause"] in legend.inner_text()
        before = picture(page, tmp_path / "without.png")
        page.get_by_label("lost palms").click()
        seen = picture(page, tmp_path / "with.png")
        changed = seen[(np.abs(seen - before).max(axis=2) > 30)]
        assert len(changed) > 200
        # Every point has the colour of the legend of its cause, such as the support's.
        style = legend.locator("div", has_text="support").locator("span").first
        color = np.array([int(n) for n in re.findall(r"[0-9]+", style.get_attribute("style"))])
        assert (np.abs(changed - color).max(axis=1) < 60).sum() > 20


def test_what_a_node_publishes_is_shown_as_it_comes(tmp_path):
    with (
        LiveNode(tmp_path / "node.log", {"default_verification": "none"}),
        NodeClient("viewer_test") as client,
    ):
        first = client.call(plan_request("sphere", time_budget=8.0, n_grasps=1))
        assert first.success, first.message
        with viewer("--ros", "--port", "8261") as address, page_at(address) as page:
            page.get_by_text("sphere in the frame world").wait_for()
            epsilon = f"0: epsilon {first.grasps[0].epsilon:.4f}"
            choice = page.locator("input[aria-haspopup=listbox]").last
            assert choice.input_value() == epsilon
            sphere = picture(page, tmp_path / "sphere.png")
            there = plan_request("mug", time_budget=12.0, n_grasps=1)
            there.object_pose.header.frame_id = "cell"
            second = client.call(there)
            assert second.success, second.message
            page.get_by_text("mug in the frame cell").wait_for()
            assert choice.input_value() == f"0: epsilon {second.grasps[0].epsilon:.4f}"
            mug = picture(page, tmp_path / "mug.png")
            assert (np.abs(mug - sphere).max(axis=2) > 30).mean() > 0.01

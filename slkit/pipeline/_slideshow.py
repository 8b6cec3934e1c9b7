"""A page that shows patterns full screen, for people whose camera is not driven by slkit."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from pathlib import Path

from slkit.files import write_text

_PAGE = """\
<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>slkit patterns</title>
<style>
  html, body { margin: 0; height: 100%; background: #000; color: #ccc; font: 18px/1.5 sans-serif; overflow: hidden }
  main { max-width: 40em; margin: 8vh auto; padding: 0 1em }
  button, input { font: inherit; padding: .3em .8em }
  input { width: 4em }
  #stage { display: none; position: fixed; inset: 0; cursor: none; background: #000 }
  #stage img { position: absolute; left: 0; top: 0; max-width: none; image-rendering: pixelated; visibility: hidden }
  #stage img.shown { visibility: visible }
  .warn { color: #fb6 }
</style>
<main id="intro">
  <h1>__COUNT__ patterns, __WIDTH__ x __HEIGHT__ px</h1>
  <p>Move this window to the projector, set the projector to its native resolution, switch off its picture correction,
  and start. Take one picture of each pattern without moving camera, projector or object.</p>
  <p id="warning" class="warn"></p>
  <p><button id="manual">Start: I press a key for the next pattern</button></p>
  <p><button id="timed">Start on a timer</button> one pattern every <input id="period" value="2" inputmode="decimal"> s,
  after <input id="delay" value="5" inputmode="decimal"> s</p>
  <p>Keys: right, space or click: next. Left: previous. Home: first. T: timer on or off. Escape: back here.</p>
</main>
<div id="stage"></div>
<script>
const files = __FILES__, width = __WIDTH__, height = __HEIGHT__;
const stage = document.getElementById("stage"), intro = document.getElementById("intro");
const seconds = id => Math.max(0.05, parseFloat(document.getElementById(id).value.replace(",", ".")) || 1);
const pictures = files.map(name => { const img = new Image(); img.src = name; stage.appendChild(img); return img; });
let current = 0, timer = null;

function fit() {
  const ratio = window.devicePixelRatio || 1;
  // One pattern pixel must fall on one projector pixel, whatever the zoom and the scaling of the desktop.
  for (const img of pictures) { img.style.width = width / ratio + "px"; img.style.height = height / ratio + "px"; }
  const w = Math.round(screen.width * ratio), h = Math.round(screen.height * ratio);
  document.getElementById("warning").textContent = w === width && h === height ? "" :
    `This screen has ${w} x ${h} px, the patterns ${width} x ${height}: ` +
    "this is not the projector, or its resolution is set wrong.";
}
function show(index) {
  current = Math.min(Math.max(index, 0), files.length - 1);
  pictures.forEach((img, i) => img.classList.toggle("shown", i === current));
}
function stop() { clearInterval(timer); timer = null; }
function advance() { current + 1 < files.length ? show(current + 1) : stop(); }
function run() { timer = setInterval(advance, 1000 * seconds("period")); }
async function start(timed) {
  // Without the permission for full screen the show goes on in its window.
  try { await document.documentElement.requestFullscreen({ navigationUI: "hide" }); } catch (error) { }
  intro.style.display = "none"; stage.style.display = "block"; fit(); show(0);
  if (timed) timer = setTimeout(run, 1000 * seconds("delay"));
}
function leave() { stop(); clearTimeout(timer); stage.style.display = "none"; intro.style.display = "block"; }

document.getElementById("manual").onclick = () => start(false);
document.getElementById("timed").onclick = () => start(true);
stage.onclick = () => show(current + 1);
window.onresize = fit;
document.onfullscreenchange = () => { if (!document.fullscreenElement) leave(); };
document.onkeydown = event => {
  if (stage.style.display !== "block") return;
  const steps = { ArrowRight: 1, " ": 1, PageDown: 1, Enter: 1, ArrowLeft: -1, PageUp: -1, Home: -files.length };
  if (event.key in steps) { event.preventDefault(); show(current + steps[event.key]); }
  else if (event.key.toLowerCase() === "t") timer === null ? run() : stop();
  else if (event.key === "Escape") leave();
};
fit();
</script>
</html>
"""


def write_slideshow(folder: Path, names: Sequence[str], projector: tuple[int, int]) -> None:
    """Write slideshow.html beside the pictures `names`; projector (width, height) px."""
    files = json.dumps(list(names)).replace("<", "\\u003c")
    values = {"COUNT": str(len(names)), "WIDTH": str(projector[0]), "HEIGHT": str(projector[1])}
    page = _PAGE
    for key, value in values.items():
        page = page.replace(f"__{key}__", html.escape(value))
    write_text(folder / "slideshow.html", page.replace("__FILES__", files))

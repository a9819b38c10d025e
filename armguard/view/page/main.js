// The page of the view: puts stage, panels, strip and feed together.
import { Camera } from "./camera.js";
import { Colours } from "./colours.js";
import { Feed } from "./feed.js";
import { Film, readFilm } from "./film.js";
import { Layers } from "./layers.js";
import { simplify } from "./meshes.js";
import { Names } from "./names.js";
import { Pace } from "./pace.js";
import { Panels } from "./panels.js";
import { savePortrait } from "./portrait.js";
import { Shapes, split } from "./shapes.js";
import { layFloor, makeStage } from "./stage.js";
import { Strip } from "./strip.js";
import { Transport } from "./transport.js";
import { age, button, clock, element, readAddress, writeAddress } from "./words.js";

const SILENCE = 1.5; // [s] without news after which the picture is no longer the present
const BREATH = 1000; // [ms] at least between two announcements

let viewer = null, shapes = null, camera = null, pace = null, source = null, transport = null;
let news = { silence: null, status: "", over: false, connected: null, problem: "", address: "" };
let lastNews = null; // [ms], of performance.now()
let lastAnnounced = -BREATH; // alike
let parted = ""; // why the view's server is not there; null: it is
const film = document.getElementById("film");

try {
  viewer = makeStage(element("pane"));
} catch (error) {
  notice("This browser cannot draw 3D (WebGL is missing or switched off). The panels still work.");
}
const panels = new Panels((token) => source.reset(token), showDepth);
const colours = new Colours(recolour);
const strip = new Strip((number) => transport.go(number));
const layers = new Layers(viewer, (volume) => source.showVolume(volume));
if (viewer !== null) {
  shapes = new Shapes(viewer, colours);
  camera = new Camera(viewer);
  pace = new Pace(viewer, (text) => panels.tellPace(text));
  new Names(viewer, shapes, camera);
  element("presets").append(
    button("picture", "save a picture with level, time and legend", () => savePortrait(viewer, panels, colours.isByLevel)));
  window.viewer = viewer; // for consoles and tests
  window.shapes = shapes;
  window.pace = pace;
  animate();
}

function animate() {
  requestAnimationFrame(animate);
  camera.move();
  pace.draw();
}

// A page that is printed is drawn at once: its pixels are taken before the next frame.
function recolour() {
  strip.draw();
  if (viewer === null) return;
  layFloor(viewer, panels.scene === null ? 0 : panels.scene.floor, colours.isLight);
  shapes.repaint();
  if (colours.isPrinting) viewer.render();
}

function notice(text) {
  element("notice").textContent = text;
  element("notice").hidden = !text;
}

function showDepth(depth) {
  panels.showDepth(depth);
  writeAddress("depth", depth);
  if (viewer === null) return;
  panels.scene.tree.forEach((_, k) => {
    viewer.scene_tree.find(["armguard", "tree", String(k)]).object.visible = k === depth;
  });
  viewer.set_dirty();
}

// ---- commands -------------------------------------------------------------------------------

const own = {
  legend: (scene) => {
    panels.showScene(scene);
    strip.levels = scene.levels;
    strip.isWhole = scene.is_recorded || film !== null;
    colours.show(scene.palette); // draws the strip anew, whose moments came before
    layers.limit(scene);
    element("time").hidden = panels.isModel;
    layers.apply();
    if (panels.isModel) showDepth(Math.min(Number(readAddress().get("depth") || 0), scene.tree.length - 1));
  },
  banner: (verdict) => {
    panels.show(verdict);
    showState();
  },
  camera: (command) => {
    if (camera === null) return;
    camera.aim(command);
    viewer.set_dirty();
  },
  // Comes before all other commands of a bundle and says how old they are, in [s].
  news: (command) => {
    news = command;
    parted = null;
    lastNews = command.silence === null ? null : performance.now() - 1000 * command.silence;
    strip.take(command);
    if (transport !== null) transport.tell();
    showState();
  },
  // Ends the commands of a moment of the past. One that cannot be drawn leads back to the present:
  // what the page shows then would be neither.
  seen: ({ number, drawn }) => {
    if (!drawn && number === transport.at) transport.goLive();
  },
  outcome: ({ text }) => panels.tellOutcome(text),
};

function take(commands) {
  for (const command of commands) {
    if (command.type in own) own[command.type](command);
    else if (viewer !== null && !shapes.draw(command)) {
      if (command.type === "delete") shapes.forget();
      viewer.handle_command(command);
      if (command.type === "set_object") simplify(viewer.scene_tree.find(split(command.path)).object);
      if (command.type === "delete") layers.apply();
    }
  }
}

// ---- what is so now -------------------------------------------------------------------------

// A picture of the past must never pass for the present.
function showState() {
  const past = transport !== null && transport.at !== null;
  const silence = lastNews === null ? Infinity : (performance.now() - lastNews) / 1000;
  const isFilm = film !== null || (news.over && !past);
  const isSilent = !isFilm && !past && silence > SILENCE;
  const verdict = panels.latest;
  let headline = verdict === null ? "…" : verdict.level || verdict.robot || "", text = "";
  let level = headline;
  if (panels.isModel) {
    headline = panels.scene.robot;
    text = "";
  } else if (past && verdict !== null) {
    const present = strip.last;
    const ago = present && film === null && !strip.isWhole ? `, ${age(Math.max(0, present.now - verdict.now))} ago` : "";
    element("past").textContent = `${film === null ? "PAST" : "FILM"} ${clock(verdict.wall, verdict.now)}${ago}`;
  } else if (parted !== null) {
    [headline, text] = ["NO VIEW", parted || "the view's server does not answer; trying again"];
  } else if (news.problem) {
    [headline, text] = ["CANNOT READ", news.problem];
  } else if (news.status && isSilent) {
    [headline, text] = ["STARTING", news.status];
  } else if (verdict !== null && !isSilent && verdict.sequence === 0) {
    [headline, text] = ["WAITING", "for the robot's joint states; the level is STOP until they arrive"];
  } else if (isSilent && lastNews === null) {
    [headline, text] = news.connected
      ? ["STARTING", "the monitor is connected and has not sent anything yet"]
      : ["WAITING", `for a monitor at ${news.address}`];
  } else if (isSilent) {
    headline = "NO DATA";
    text = news.connected === false
      ? `the monitor has disconnected, ${age(silence)} ago (last: ${verdict ? verdict.level : "nothing"}); waiting for it at ${news.address}`
      : `no data for ${age(silence)} (last: ${verdict ? verdict.level : "nothing"})`;
  } else if (news.over && film === null) {
    text = news.status;
  }
  const isUnknown = headline !== level || panels.isModel;
  panels.headline(headline || "…", isUnknown ? "" : level);
  announce(past ? `past: ${headline}` : headline);
  document.body.classList.toggle("silent", (isSilent || parted !== null) && !past && film === null && !panels.isModel);
  document.body.classList.toggle("past", past && !strip.isWhole);
  element("past").hidden = !past || panels.isModel;
  element("silence").textContent = text;
  element("silence").hidden = !text;
}
setInterval(showState, 100);

// Readers of the screen hear of a change of level, and of no number; the newest, once a second.
function announce(text) {
  const now = performance.now();
  const isNews = text !== element("announcement").textContent && text !== "…";
  if (!isNews || now - lastAnnounced < BREATH) return;
  lastAnnounced = now;
  element("announcement").textContent = text;
}

// ---- where it comes from --------------------------------------------------------------------

const show = (number, drawn) => {
  source.seek(number, drawn);
  showState();
};
element("time").hidden = false;
if (film === null) {
  transport = new Transport(strip, show, { hasPresent: true });
  source = new Feed(take, (reason) => { parted = reason || ""; showState(); });
  if (layers.wantsVolume) source.showVolume(true);
} else {
  readFilm(film.textContent).then((content) => {
    film.remove();
    parted = null;
    source = new Film(content, take);
    transport = new Transport(strip, show, { hasPresent: false });
    transport.see(strip.moments[0].number);
    transport.toggle();
  }, (error) => notice(`This film cannot be read: ${error.message}`));
}

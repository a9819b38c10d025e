// A picture to send to somebody: the scene, with level, time and legend in it.
import { tone } from "./colours.js";
import { brief, clock, element, seconds, stopTime } from "./words.js";

export function savePortrait(viewer, panels, isByLevel) {
  viewer.render();
  const scene = viewer.renderer.domElement;
  const picture = document.createElement("canvas");
  picture.width = scene.width;
  picture.height = scene.height;
  const pen = picture.getContext("2d"), unit = Math.max(12, scene.height / 42);
  pen.drawImage(scene, 0, 0);
  const verdict = panels.latest;
  const lines = [[`${element("sign").textContent} ${element("level").textContent}`,
    tone("--level"), 2]];
  if (verdict !== null) {
    lines.push([clock(verdict.wall, verdict.now), tone("--ink"), 1]);
    const harm = verdict.harm_time === null ? "" : `harm time ${seconds(verdict.harm_time)}, `;
    lines.push([
      `contact time ${seconds(verdict.contact_time)}, ${harm}stop time ${stopTime(verdict.stop_time)}`,
      tone("--ink"), 1,
    ]);
    lines.push([element("cause").textContent.trim().slice(0, 90), tone("--ink"), 1]);
    lines.push(...verdict.reasons.slice(0, 2).map((text) => [text.slice(0, 90), tone("--faint"), 1]));
  }
  let top = 0.5 * unit;
  for (const [text, colour, size] of lines) {
    pen.font = `${size > 1 ? 700 : 400} ${size * unit}px system-ui, sans-serif`;
    top += 1.3 * size * unit;
    pen.fillStyle = colour;
    pen.fillText(text, unit, top);
  }
  pen.font = `${unit}px system-ui, sans-serif`;
  const { levels, buckets, period } = panels.scene, bottom = picture.height - 0.4 * unit;
  if (isByLevel) {
    levels.forEach(({ name, sign, paint }, k) => {
      pen.fillStyle = tone(`--paint-${paint}`);
      pen.fillText(`${sign} ${name}`, unit, bottom - 1.4 * unit * (levels.length - 1 - k));
    });
  } else {
    const wide = Math.min(1.6 * unit, (picture.width - 2 * unit) / buckets);
    for (let k = 0; k < buckets; k++) {
      pen.fillStyle = tone(`--paint-${k}`);
      pen.fillRect(unit + k * wide, bottom - 2 * unit, wide - 2, 0.8 * unit);
      if (k % 3 === 0) pen.fillText(k ? brief(period * 2 ** k) : "0", unit + k * wide, bottom);
    }
  }
  const link = document.createElement("a");
  link.download = "armguard.png";
  link.href = picture.toDataURL("image/png");
  link.click();
}

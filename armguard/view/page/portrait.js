// A picture to send to somebody: the scene, with level, time and legend in it.
import { clock, element, seconds, stopTime } from "./words.js";

export function savePortrait(viewer, panels) {
  viewer.render();
  const scene = viewer.renderer.domElement;
  const picture = document.createElement("canvas");
  picture.width = scene.width;
  picture.height = scene.height;
  const pen = picture.getContext("2d"), unit = Math.max(12, scene.height / 42);
  pen.drawImage(scene, 0, 0);
  const verdict = panels.latest;
  const lines = [[`${element("sign").textContent} ${element("level").textContent}`,
    getComputedStyle(document.documentElement).getPropertyValue("--level"), 2]];
  if (verdict !== null) {
    lines.push([clock(verdict.wall, verdict.now), "#e9eef4", 1]);
    lines.push([`contact time ${seconds(verdict.contact_time)}, stop time ${stopTime(verdict.stop_time)}`, "#e9eef4", 1]);
    lines.push(...verdict.reasons.slice(0, 2).map((text) => [text.slice(0, 90), "#a3b0be", 1]));
  }
  let top = 0.5 * unit;
  for (const [text, colour, size] of lines) {
    pen.font = `${size > 1 ? 700 : 400} ${size * unit}px system-ui, sans-serif`;
    top += 1.3 * size * unit;
    pen.fillStyle = colour;
    pen.fillText(text, unit, top);
  }
  pen.font = `${unit}px system-ui, sans-serif`;
  top = picture.height - 1.4 * unit * panels.levels.size;
  for (const [name, { sign, colour }] of panels.levels) {
    top += 1.4 * unit;
    pen.fillStyle = colour;
    pen.fillText(`${sign} ${name}`, unit, top - unit);
  }
  const link = document.createElement("a");
  link.download = "armguard.png";
  link.href = picture.toDataURL("image/png");
  link.click();
}

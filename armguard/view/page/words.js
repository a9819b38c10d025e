// How numbers read.

export const element = (id) => document.getElementById(id);

export function seconds(value) {
  if (!(value < Infinity)) return value === Infinity ? "none possible" : "unknown";
  return value < 0.9995 ? `${(1000 * value).toFixed(0)} ms` : `${value.toFixed(value < 10 ? 2 : 1)} s`;
}

// The same for labels with little room: 256ms, 4.1s.
export function brief(value) {
  return value < 0.9995 ? `${Number((1000 * value).toPrecision(3))}ms` : `${Number(value.toPrecision(2))}s`;
}

export function stopTime(value) {
  return value < Infinity ? seconds(value) : "unknown";
}

// Of a contact.
export function speed(value) {
  if (!(value < Infinity)) return "unknown";
  return value > 0 ? `at most ${value.toFixed(2)} m/s` : "no contact before rest";
}

export function microseconds(value) {
  if (!(value < Infinity)) return "–";
  return value < 0.9995e-3 ? `${(1e6 * value).toFixed(0)} µs` : `${(1e3 * value).toFixed(1)} ms`;
}

// A duration that people wait for: 4.2 s, 3 min 20 s.
export function age(value) {
  if (value < 60) return `${value.toFixed(1)} s`;
  const whole = Math.round(value);
  return `${Math.floor(whole / 60)} min ${whole % 60} s`;
}

// Time of day where it is known, else the monitor's own.
export function clock(wall, now) {
  if (!(wall > 0)) return `${now.toFixed(2)} s`;
  const date = new Date(1000 * wall);
  const two = (number) => String(number).padStart(2, "0");
  const tenth = Math.floor(date.getMilliseconds() / 100);
  return `${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}.${tenth}`;
}

export function item(text, kind) {
  const row = document.createElement("li");
  row.textContent = text;
  if (kind) row.className = kind;
  return row;
}

// Prose with code between backticks. All of it is text, whatever it looks like.
export function prose(place, text) {
  place.append(...text.split(/`([^`]*)`/).map((part, k) => {
    if (k % 2 === 0) return part;
    const code = document.createElement("code");
    code.textContent = part;
    return code;
  }));
  return place;
}

export function button(text, title, act) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = text;
  made.title = title;
  // Who speaks to the page says what stands on a button.
  made.setAttribute("aria-label", /^\w/.test(text) && !title.includes(text) ? `${text}: ${title}` : title);
  made.addEventListener("click", act);
  return made;
}

// What the page remembers in its address, so that a link shows the same.
export function readAddress() {
  return new URLSearchParams(location.hash.slice(1));
}

export function writeAddress(name, value) {
  const words = readAddress();
  if (value === null) words.delete(name);
  else words.set(name, value);
  history.replaceState(null, "", `#${words.toString().replaceAll("%2C", ",")}`);
}

"use strict";
const all = JSON.parse(document.getElementById("sound").textContent);
const find = (name) => document.getElementById(name);
const canvas = find("chart"), speed = find("speed"), depth = find("depth"), said = find("said"), play = find("play");
const bytes = (text) => Int8Array.from(atob(text), (one) => one.charCodeAt(0) << 24 >> 24);
const classes = bytes(all.classes), samples = bytes(all.samples);
const [S, B] = [all.speeds.length, all.depths.length];
const names = ["stable", "chatter (Neimark-Sacker)", "chatter (flip)", "chatter (saddle-node)"];
const colours = ["#ffffff", "#9ecae1", "#fdae6b", "#c7a0d9"];
const left = 52, below = 40, above = 8;
const nearest = (row, value) => row.reduce((best, one, place) =>
  Math.abs(one - value) < Math.abs(row[best] - value) ? place : best, 0);
let now = {speed: 0, depth: 0}, heard = -1, context = null, source = null;

function place() {
  const width = canvas.width - left - 8, height = canvas.height - above - below;
  const [s0, s1, b0, b1] = [all.speeds[0], all.speeds[S - 1], all.depths[0], all.depths[B - 1]];
  return {width, height, x: (rpm) => left + width * (rpm - s0) / (s1 - s0), y: (mm) => above + height * (b1 - mm) / (b1 - b0),
    rpm: (x) => s0 + (s1 - s0) * Math.min(Math.max((x - left) / width, 0), 1),
    mm: (y) => b1 - (b1 - b0) * Math.min(Math.max((y - above) / height, 0), 1)};
}

function draw() {
  canvas.width = canvas.clientWidth;
  canvas.height = Math.round(0.6 * canvas.width);
  const pen = canvas.getContext("2d"), at = place(), ink = getComputedStyle(document.body).color;
  const [w, h] = [at.width / (S - 1) + 1, at.height / (B - 1) + 1];
  pen.save();
  pen.beginPath();
  pen.rect(left, above, at.width, at.height);
  pen.clip();
  for (let b = 0; b < B; b++) for (let s = 0; s < S; s++) {
    const kind = classes[b * S + s];
    pen.fillStyle = kind < 0 ? "#bbbbbb" : colours[kind];
    pen.fillRect(at.x(all.speeds[s]) - w / 2, at.y(all.depths[b]) - h / 2, w, h);
  }
  pen.fillStyle = "rgba(0,0,0,.35)";
  for (const one of all.cuts) pen.fillRect(at.x(one.speed) - 1.5, at.y(one.depth) - 1.5, 3, 3);
  pen.restore();
  pen.strokeStyle = pen.fillStyle = ink;
  pen.strokeRect(left, above, at.width, at.height);
  pen.font = "12px sans-serif";
  const ticks = canvas.width < 500 ? 3 : 6;
  for (let k = 0; k <= ticks; k++) {
    const rpm = all.speeds[0] + (all.speeds[S - 1] - all.speeds[0]) * k / ticks;
    pen.textAlign = k === 0 ? "left" : k === ticks ? "right" : "center";
    pen.fillText(rpm.toFixed(0), at.x(rpm), canvas.height - below + 16);
    const mm = all.depths[0] + (all.depths[B - 1] - all.depths[0]) * k / ticks;
    pen.textAlign = "right";
    pen.fillText(mm.toPrecision(3), left - 4, at.y(mm) + (k === ticks ? 10 : 4));
  }
  pen.textAlign = "center";
  pen.fillText("spindle speed [rpm]", left + at.width / 2, canvas.height - 6);
  pen.save();
  pen.translate(11, above + at.height / 2);
  pen.rotate(-Math.PI / 2);
  pen.fillText("axial depth of cut [mm]", 0, 0);
  pen.restore();
  const [x, y] = [at.x(now.speed), at.y(now.depth)];
  pen.lineWidth = 2;
  pen.strokeStyle = "#b3363f";
  pen.beginPath();
  pen.arc(x, y, 8, 0, 7);
  pen.moveTo(x - 13, y); pen.lineTo(x + 13, y);
  pen.moveTo(x, y - 13); pen.lineTo(x, y + 13);
  pen.stroke();
}

function sound(cut) {
  if (!context) return;
  if (source) {
    source.gain.gain.linearRampToValueAtTime(0, context.currentTime + 0.04);
    source.node.stop(context.currentTime + 0.05);
    source = null;
  }
  const one = all.cuts[cut];
  if (!one || !one.count) return;
  const buffer = context.createBuffer(1, one.count, all.rate), row = buffer.getChannelData(0);
  for (let k = 0; k < one.count; k++) row[k] = samples[one.first + k] / 127;
  const node = context.createBufferSource(), gain = context.createGain();
  node.buffer = buffer;
  node.loop = true;
  gain.gain.setValueAtTime(0, context.currentTime);
  gain.gain.linearRampToValueAtTime(one.gain, context.currentTime + 0.04);
  node.connect(gain).connect(context.destination);
  node.start();
  source = {node, gain};
}

function known(rpm, mm) {
  const kind = classes[nearest(all.depths, mm) * S + nearest(all.speeds, rpm)];
  return kind < 0 ? "not known" : names[kind];
}

function moved(rpm, mm) {
  now = {speed: rpm, depth: mm};
  speed.value = rpm;
  depth.value = mm;
  const reach = [all.speeds[S - 1] - all.speeds[0], all.depths[B - 1] - all.depths[0]];
  const far = (one) => Math.hypot((one.speed - rpm) / reach[0], (one.depth - mm) / reach[1]);
  const cut = all.cuts.reduce((best, one, k) => far(one) < far(all.cuts[best]) ? k : best, 0), one = all.cuts[cut];
  said.textContent = `${rpm.toFixed(0)} rpm, ${mm.toFixed(2)} mm: ${known(rpm, mm)}. ` +
    `To hear: the cut simulated at ${one.speed.toFixed(0)} rpm, ${one.depth.toFixed(2)} mm, ` +
    `${known(one.speed, one.depth)}, ${one.said}.`;
  draw();
  if (cut !== heard) {
    heard = cut;
    if (source || (context && play.dataset.on)) sound(cut);
  }
}

play.onclick = () => {
  if (play.dataset.on) {
    delete play.dataset.on;
    play.textContent = "Play";
    sound(-1);
    return;
  }
  context = context || new AudioContext();
  context.resume();
  play.dataset.on = "1";
  play.textContent = "Stop";
  sound(heard);
};
for (const [one, row] of [[speed, all.speeds], [depth, all.depths]]) {
  one.min = row[0];
  one.max = row[row.length - 1];
  one.step = (one.max - one.min) / 400;
  one.oninput = () => moved(+speed.value, +depth.value);
}
function pointed(event) {
  const box = canvas.getBoundingClientRect(), at = place(), share = canvas.width / box.width;
  moved(at.rpm((event.clientX - box.left) * share), at.mm((event.clientY - box.top) * share));
}
canvas.onpointerdown = (event) => { canvas.setPointerCapture(event.pointerId); pointed(event); };
canvas.onpointermove = (event) => { if (event.buttons) pointed(event); };
window.onresize = draw;
moved(0.5 * (all.speeds[0] + all.speeds[S - 1]), 0.5 * (all.depths[0] + all.depths[B - 1]));
document.documentElement.dataset.ready = "1";

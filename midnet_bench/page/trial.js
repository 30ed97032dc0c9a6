// A recorded trial on the page: how it is unpacked, what is wrong in it, and where. No browser is needed here.
"use strict";

const STEP_M = 0.005; // lengths and places are whole multiples of it, angles of as many radians
const TEAM = 32;
const KINDS = ["miss", "false", "fragment"];
const KIND_NAMES = { miss: "missed", false: "false positive", fragment: "second box on one intruder" };

/** The other side of recording.py's packed(): bytes -> list -> {start, rows}, rows being one array per column. */
function unpack(bytes, columns, frames) {
  let at = 0;
  const read = (count) => {
    const words = new Int16Array(count);
    for (let i = 0; i < count; i++) {
      const word = bytes[at + i] | (bytes[at + count + i] << 8);
      words[i] = (word >>> 1) ^ -(word & 1);
    }
    at += 2 * count;
    return words;
  };
  const lists = {};
  for (const [list, names] of Object.entries(columns)) {
    const counts = read(frames);
    const start = new Int32Array(frames + 1);
    for (let f = 0, count = 0; f < frames; f++) {
      count += counts[f];
      start[f + 1] = start[f] + count;
    }
    const total = start[frames];
    const rows = {};
    const before = new Int32Array(total).fill(-1); // the last row with the same key
    names.forEach((name, number) => {
      const values = read(total);
      if (number > 0) {
        for (let i = 0; i < total; i++) if (before[i] >= 0) values[i] += values[before[i]];
      } else {
        const last = new Int32Array(65536).fill(-1);
        for (let f = 0; f < frames; f++) {
          for (let i = start[f]; i < start[f + 1]; i++) {
            const same = f > 0 ? start[f - 1] + i - start[f] : -1;
            if (same >= 0 && same < start[f]) values[i] += values[same];
            before[i] = last[values[i] & 0xffff];
            last[values[i] & 0xffff] = i;
          }
        }
      }
      rows[name] = values;
    });
    lists[list] = { start, rows };
  }
  return lists;
}

/** The rows of a list at a frame (from 0), as objects by column. */
function rowsAt(list, frame) {
  const rows = [];
  for (let i = list.start[frame]; i < list.start[frame + 1]; i++) {
    rows.push(Object.fromEntries(Object.entries(list.rows).map(([name, values]) => [name, values[i]])));
  }
  return rows;
}

/** What is wrong at a frame: [{kind, cause, guard, who, by, age_s, offset_m, box}], boxes in steps. */
function errorsAt(head, lists, frame) {
  const word = (number) => (number > 0 ? head.words[number - 1] : "");
  if (head.explained) {
    return rowsAt(lists.errors, frame).map((row) => ({
      kind: KINDS[row.kind],
      cause: word(row.cause),
      guard: row.guard,
      who: word(row.who),
      by: word(row.by),
      age_s: row.age / 100,
      offset_m: row.offset * STEP_M,
      box: row,
    }));
  }
  const blank = { cause: "", by: "", age_s: 0, offset_m: 0 };
  const missed = rowsAt(lists.truths, frame)
    .filter((truth) => truth.counts && !truth.detection)
    .map((truth) => ({ ...blank, kind: "miss", guard: 0, who: word(truth.name), box: truth }));
  const truths = rowsAt(lists.truths, frame);
  const left = rowsAt(lists.detections, frame)
    .filter((box) => !box.truth)
    .map((box) => ({
      ...blank, kind: truths.some((truth) => overlap(box, truth)) ? "fragment" : "false",
      guard: (box.track % TEAM) + 1, who: "", box,
    }));
  return [...missed, ...left];
}

/** Whether two boxes have a common area. */
function overlap(a, b) {
  return a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height;
}

/** Errors that go on from frame to frame, as one: [{...error, first, last}], by their first frames (from 0). */
function episodes(head, lists) {
  const found = [];
  let open = new Map();
  for (let frame = 0; frame < head.frames; frame++) {
    const now = new Map();
    for (const error of errorsAt(head, lists, frame)) {
      // boxes of one guard for one cause are told apart by where they are, to about half a metre
      const place = error.kind === "miss" ? "" : `${error.box.x >> 6},${error.box.y >> 6}`;
      const key = [error.kind, error.cause, error.kind === "miss" ? error.who : error.guard, place].join("|");
      const known = now.get(key) || open.get(key) || { ...error, first: frame };
      if (known.first === frame && !now.has(key)) found.push(known);
      known.last = frame;
      now.set(key, known);
    }
    open = now;
  }
  return found;
}

/** Per frame: found, missed and false boxes so far, at the frame itself in `at`. */
function tally(head, lists) {
  const totals = { found: [], missed: [], false: [] };
  const so_far = { found: 0, missed: 0, false: 0 };
  for (let frame = 0; frame < head.frames; frame++) {
    so_far.found += rowsAt(lists.detections, frame).filter((box) => box.truth).length;
    for (const error of errorsAt(head, lists, frame)) so_far[error.kind === "miss" ? "missed" : "false"]++;
    for (const name of Object.keys(totals)) totals[name].push(so_far[name]);
  }
  return totals;
}

/** The counts of one frame. */
function countsAt(totals, frame) {
  const at = (name) => totals[name][frame] - (frame > 0 ? totals[name][frame - 1] : 0);
  return { found: at("found"), missed: at("missed"), false: at("false") };
}

/** One-to-one F1 up to a frame; null where nothing was there to be found. */
function f1(totals, frame) {
  const found = totals.found[frame];
  const all = 2 * found + totals.missed[frame] + totals.false[frame];
  return all > 0 ? (2 * found) / all : null;
}

/** One-to-one F1 of the last `frames` frames up to one; null where nothing was there to be found. */
function recentF1(totals, frame, frames) {
  const first = frame - frames;
  const of = (name) => totals[name][frame] - (first < 0 ? 0 : totals[name][first]);
  const all = 2 * of("found") + of("missed") + of("false");
  return all > 0 ? (2 * of("found")) / all : null;
}

/** The first frame of the next (or, for -1, the previous) episode from a frame on; null if there is none. */
function neighbour(list, frame, direction) {
  const firsts = list.map((one) => one.first).filter((first) => (first - frame) * direction > 0);
  return firsts.length ? (direction > 0 ? Math.min(...firsts) : Math.max(...firsts)) : null;
}

const plain = (name) => name.replaceAll("_", " ");

/** Its cause in words; none of a second box, whose kind says it already. */
const causeOf = (error) => (error.kind === error.cause ? "" : plain(error.cause));

/** An error in words: "missed: intruder 3, outside window". */
function inWords(error) {
  const whose = error.guard > 0 ? `guard ${error.guard}` : "";
  const parts = [error.kind === "miss" ? error.who : whose, causeOf(error)];
  if (error.by && error.by !== error.who) parts.push(error.by);
  if (error.kind === "miss" && whose) parts.push(`at ${whose}`);
  if (error.age_s >= 0.05) parts.push(`${error.age_s.toFixed(1)} s old`);
  if (error.offset_m >= 0.005) parts.push(`${Math.round(100 * error.offset_m)} cm off`);
  return `${KIND_NAMES[error.kind]}: ${parts.filter(Boolean).join(", ")}`;
}

/** "#trial=2&frame=40" -> {trial: 2, frame: 40}; what is no whole number is left out, but cause. */
function parseHash(hash) {
  const found = {};
  for (const [name, value] of new URLSearchParams(hash.replace(/^#/, ""))) {
    if (name === "cause") found.cause = value;
    else if (/^\d+$/.test(value)) found[name] = Number(value);
  }
  return found;
}

if (typeof module !== "undefined") {
  module.exports = {
    unpack, rowsAt, errorsAt, episodes, tally, countsAt, f1, recentF1, neighbour, inWords, parseHash,
  };
}

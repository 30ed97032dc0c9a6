// The trial player: draws a trial of trial.js, frame by frame, and moves through it.
"use strict";

(function () {
  const data = document.getElementById("trials");
  if (!data) return;
  const { trials, columns, scanColumns } = JSON.parse(data.textContent);
  const $ = (id) => document.getElementById(id);
  const canvas = $("arena"), strip = $("strip"), curve = $("curve"), scrub = $("scrub"), section = $("player");
  const SECOND = 5; // frames an arrow key moves
  const SCALES_M = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20];
  const LEAST_PX = 11; // a robot is drawn at least so long
  const now = { trial: -1, frame: 0, playing: false, since: 0, focus: null, head: null, shown: [], asked: 0 };
  let colours = {};

  // ---- data

  async function inflated(id) {
    const script = $(id);
    if (!script) return null;
    const packed = Uint8Array.from(atob(script.textContent.trim()), (char) => char.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  async function load(number, frame) {
    const asked = ++now.asked;
    const head = trials[number];
    const [bytes, scans] = await Promise.all([inflated(`trial-${number}`), inflated(`scans-${number}`)]);
    if (asked !== now.asked) return; // another trial was chosen meanwhile
    const lists = unpack(bytes, columns, head.frames);
    Object.assign(now, {
      trial: number, head, lists, focus: null,
      scans: scans && unpack(scans, scanColumns, head.frames),
      episodes: episodes(head, lists),
      totals: tally(head, lists),
    });
    scrub.max = head.frames;
    $("summary").textContent = head.summary;
    $("no-scans").hidden = scans !== null;
    $("show-scans").disabled = scans === null;
    fillCauses();
    fillErrors();
    fillEvents();
    size();
    go(Math.min(frame, head.frames - 1));
  }

  // ---- choices

  function fill(select, options) {
    select.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
  }

  function fillCells() {
    fill($("cell"), [...new Set(trials.map((head) => head.cell))].map((cell) => [cell, cell]));
  }

  function fillSeeds(cell) {
    const seeds = trials.map((head, number) => [number, head]).filter(([, head]) => head.cell === cell);
    fill($("seed"), seeds.map(([number, head]) => [number, String(head.seed)]));
  }

  function fillCauses() {
    const counts = new Map();
    const kinds = [
      ["all", "all errors"], ["miss", "all misses"], ["false", "all false positives"], ["fragment", "all second boxes"],
    ];
    for (const one of now.episodes) if (one.cause) counts.set(one.cause, (counts.get(one.cause) || 0) + 1);
    const causes = [...counts].sort((a, b) => b[1] - a[1]).map(([name, n]) => [name, `${plain(name)} (${n})`]);
    const before = $("cause").value;
    fill($("cause"), [...kinds, ...causes]);
    $("cause").value = before;
    if (!$("cause").value) $("cause").value = "all";
  }

  function isChosen(one) {
    const cause = $("cause").value;
    if (cause === "all") return true;
    if (cause in KIND_NAMES) return one.kind === cause;
    return one.cause === cause;
  }

  function fillErrors() {
    const chosen = now.episodes.filter(isChosen);
    now.shown = chosen.map((one) => {
      const button = document.createElement("button");
      const time = document.createElement("span");
      time.className = "time";
      time.textContent = `${((one.first + 1) / now.head.hz).toFixed(1)} s`;
      const lasts = (one.last - one.first + 1) / now.head.hz;
      const sign = document.createElement("span");
      sign.className = `sign ${one.kind}`;
      sign.textContent = { miss: "!", false: "×", fragment: "2" }[one.kind];
      sign.setAttribute("aria-hidden", "true");
      const text = document.createElement("span");
      text.textContent = `${inWords(one)}; lasts ${lasts.toFixed(1)} s`;
      button.type = "button";
      button.append(time, sign, text);
      button.addEventListener("click", () => { pause(); now.focus = one; go(one.first); });
      const item = document.createElement("li");
      item.append(button);
      return { one, button, item };
    });
    $("errors").replaceChildren(...now.shown.map(({ item }) => item));
    $("error-count").textContent = `${chosen.length} in this trial`;
    drawStrip();
  }

  function fillEvents() {
    $("events").replaceChildren(...now.head.events.map(([frame, , text]) => {
      const [item, button] = [document.createElement("li"), document.createElement("button")];
      button.type = "button";
      button.textContent = text;
      button.addEventListener("click", () => { pause(); go(frame - 1); });
      item.append(button);
      return item;
    }));
  }

  /** Shows in the list what goes on now, or comes next. */
  function scrollErrors() {
    const list = $("errors");
    const here = now.shown.find(({ one }) => one.last >= now.frame);
    if (!here) return;
    const { top, bottom } = here.button.getBoundingClientRect();
    const frame = list.getBoundingClientRect();
    if (top < frame.top || bottom > frame.bottom) list.scrollTop += top - frame.top - 8;
  }

  // ---- moving

  function go(frame) {
    now.frame = Math.max(0, Math.min(frame, now.head.frames - 1));
    scrub.value = now.frame + 1;
    tell();
    draw();
    drawStrip();
    drawCurve();
  }

  function play() {
    if (now.frame >= now.head.frames - 1) go(0);
    now.playing = true;
    now.since = performance.now();
    button();
    requestAnimationFrame(step);
  }

  function pause() {
    if (!now.playing) return;
    now.playing = false;
    button();
    tell();
  }

  function step(time) {
    if (!now.playing) return;
    const frames = Math.floor(((time - now.since) / 1000) * now.head.hz * Number($("speed").value));
    if (frames > 0) {
      now.since = time;
      go(now.frame + frames);
      if (now.frame >= now.head.frames - 1) return pause();
    }
    requestAnimationFrame(step);
  }

  function button() {
    $("play").textContent = now.playing ? "❚❚" : "▶";
    $("play").setAttribute("aria-label", now.playing ? "Pause (space)" : "Play (space)");
    $("play").title = $("play").getAttribute("aria-label");
  }

  function toError(direction) {
    const frame = neighbour(now.episodes.filter(isChosen), now.frame, direction);
    if (frame === null) return;
    pause();
    now.focus = now.episodes.find((one) => one.first === frame && isChosen(one));
    go(frame);
  }

  function toggle() { if (now.playing) pause(); else play(); }

  const KEYS = {
    " ": toggle,
    ArrowLeft: () => go(now.frame - SECOND),
    ArrowRight: () => go(now.frame + SECOND),
    ",": () => { pause(); go(now.frame - 1); },
    ".": () => { pause(); go(now.frame + 1); },
    n: () => toError(1),
    p: () => toError(-1),
    Home: () => go(0),
    End: () => go(now.head.frames - 1),
  };

  function isInView() {
    const { top, bottom } = canvas.getBoundingClientRect();
    return top < window.innerHeight && bottom > 0;
  }

  function onKey(event) {
    const { key, target } = event;
    if (!now.head || event.ctrlKey || event.metaKey || event.altKey || !(key in KEYS)) return;
    const elsewhere = target !== document.body && !section.contains(target);
    if (elsewhere || (target === document.body && !isInView())) return;
    const name = target.tagName;
    if (name === "SELECT" || (name === "INPUT" && key !== "n" && key !== "p" && key !== "," && key !== ".")) return;
    if (key === " " && (name === "BUTTON" || name === "SUMMARY" || name === "A")) return;
    event.preventDefault();
    KEYS[key]();
  }

  // ---- words

  function tell() {
    const { head, totals, frame } = now;
    const errors = errorsAt(head, now.lists, frame);
    const counts = countsAt(totals, frame);
    const time = `${((frame + 1) / head.hz).toFixed(1)} s`;
    const score = f1(totals, frame);
    const happened = head.events.filter(([at]) => at <= frame + 1);
    const so_far = `${totals.found[frame]} found, ${totals.missed[frame]} missed, ${totals.false[frame]} false or second boxes`;
    $("where").textContent = `frame ${frame + 1} of ${head.frames} · ${time}`;
    $("frame-counts").textContent = `now: ${counts.found} found, ${counts.missed} missed, ${counts.false} false or second boxes`;
    $("total-counts").textContent = `so far: ${so_far}${score === null ? "" : `, one-to-one F1 ${score.toFixed(3)}`}`;
    const whats = [...new Set(head.events.map(([, what]) => what))];
    const score_of = (what) => `${happened.filter((event) => event[1] === what).length} ${what}`;
    $("score").textContent = whats.map(score_of).join(", ");
    [...$("events").querySelectorAll("button")].forEach((each, number) => {
      if (number < happened.length) each.setAttribute("aria-current", "true");
      else each.removeAttribute("aria-current");
    });
    scrub.setAttribute("aria-valuetext", `frame ${frame + 1}, ${time}`);
    for (const { one, button: each } of now.shown) {
      const isOn = one.first <= frame && frame <= one.last;
      if (isOn !== each.hasAttribute("aria-current")) {
        if (isOn) each.setAttribute("aria-current", "true"); else each.removeAttribute("aria-current");
      }
    }
    if (now.playing) return;
    scrollErrors();
    const said = errors.length ? errors.map(inWords).join("; ") : "no errors";
    const text = `Frame ${frame + 1}, ${time}. ${said}. ${happened.length ? happened.at(-1)[2] : ""}`;
    $("live").textContent = text;
    canvas.setAttribute("aria-label", `${head.plan.title}, ${head.cell}. ${text}`);
    // a link to this moment; not before somebody has moved, or a link to a chapter would be lost
    if (section.dataset.ready) history.replaceState(null, "", `#trial=${now.trial}&frame=${frame + 1}`);
  }

  // ---- pictures

  function readColours() {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["floor", "ground", "wood", "wood-edge", "ink", "faint-ink", "guard", "guard-faint",
      "guard-range", "intruder", "intruder-faint", "detection", "false-detection", "missed", "line", "soft", "paper"]) {
      colours[name] = style.getPropertyValue(`--${name}`).trim();
    }
  }

  function size() {
    const [x0, y0, x1, y1] = now.head.plan.view;
    const ratio_of_sides = (x1 - x0) / (y1 - y0);
    const width = Math.min(canvas.parentElement.clientWidth, 0.8 * window.innerHeight * ratio_of_sides);
    canvas.style.width = `${width}px`;
    canvas.style.height = `${width / ratio_of_sides}px`;
    for (const one of [canvas, strip, curve]) {
      const ratio = window.devicePixelRatio || 1;
      one.width = Math.max(1, Math.round(one.clientWidth * ratio));
      one.height = Math.max(1, Math.round(one.clientHeight * ratio));
    }
  }

  function viewed() {
    const [x0, y0, x1, y1] = now.head.plan.view;
    const zoom = Number($("zoom").value);
    const box = now.focus && now.focus.box;
    const centre = box
      ? [(box.x + box.width / 2) * STEP_M, (box.y + box.height / 2) * STEP_M]
      : [(x0 + x1) / 2, (y0 + y1) / 2];
    const [w, h] = [(x1 - x0) / zoom, (y1 - y0) / zoom];
    const left = Math.max(x0, Math.min(centre[0] - w / 2, x1 - w));
    const low = Math.max(y0, Math.min(centre[1] - h / 2, y1 - h));
    return { left, top: low + h, scale: canvas.width / w };
  }

  function draw() {
    const { head, lists, frame } = now;
    const context = canvas.getContext("2d");
    const ratio = window.devicePixelRatio || 1;
    const view = viewed();
    const px = (x) => (x - view.left) * view.scale;
    const py = (y) => (view.top - y) * view.scale;
    const shows = (layer) => $(`show-${layer}`).checked;
    const path = (flat) => {
      context.beginPath();
      for (let i = 0; i < flat.length; i += 2) context.lineTo(px(flat[i]), py(flat[i + 1]));
      context.closePath();
    };
    const line = (colour, width, dash) => {
      context.strokeStyle = colours[colour];
      context.lineWidth = width * ratio;
      context.setLineDash((dash || []).map((each) => each * ratio));
    };
    const fillPath = (flat, colour) => { path(flat); context.fillStyle = colours[colour]; context.fill(); };
    const sides = (box) => [
      px(box.x * STEP_M), py((box.y + box.height) * STEP_M),
      box.width * STEP_M * view.scale, box.height * STEP_M * view.scale,
    ];
    const boxOf = (box, colour, width, dash) => { line(colour, width, dash); context.strokeRect(...sides(box)); };
    const taken = []; // by labels: left, top, right, bottom
    /** A label at the first of [[x, y], ...] where no other one is; without such a place it is left out. */
    const words = (text, spots, colour) => {
      context.font = `600 ${12 * ratio}px system-ui, sans-serif`;
      const half = context.measureText(text).width / 2 + 2 * ratio, high = 8 * ratio;
      const inside = (x) => Math.max(half, Math.min(x, canvas.width - half));
      const free = spots.find(([x, y]) => x > 0 && x < canvas.width && y > high && y < canvas.height - high
        && !taken.some(([l, t, r, b]) => inside(x) - half < r && l < inside(x) + half && y - high < b && t < y + high));
      if (!free) return;
      const at = inside(free[0]), y = free[1];
      taken.push([at - half, y - high, at + half, y + high]);
      context.textAlign = "center";
      context.textBaseline = "middle";
      context.lineJoin = "round";
      line("floor", 3.5);
      context.strokeText(text, at, y);
      context.fillStyle = colours[colour];
      context.fillText(text, at, y);
    };

    context.fillStyle = colours.ground;
    context.fillRect(0, 0, canvas.width, canvas.height);
    const [ex0, ey0, ex1, ey1] = head.plan.enclosure;
    fillPath([ex0, ey0, ex1, ey0, ex1, ey1, ex0, ey1], "floor");
    for (const wall of head.plan.walls) fillPath(wall, "wood");
    for (const one of head.plan.stationary) {
      fillPath(one, "intruder-faint");
      line("intruder", 1);
      context.stroke();
    }
    if (shows("window")) drawReach(context, rowsAt(lists.robots, frame), px, py, view.scale, line);
    if (shows("scans") && now.scans) drawScans(context, px, py, ratio);
    const robots = rowsAt(lists.robots, frame);
    if (shows("goals")) {
      robots.forEach((robot) => {
        if (!robot.here || !robot.goal || !head.robots[robot.robot].guard) return;
        const chases = robot.goal === 2;
        line(chases ? "guard" : "guard-faint", chases ? 2.5 : 1, chases ? [] : [2, 4]);
        context.beginPath();
        context.moveTo(px(robot.x * STEP_M), py(robot.y * STEP_M));
        const [gx, gy] = [px(robot.goal_x * STEP_M), py(robot.goal_y * STEP_M)];
        context.lineTo(gx, gy);
        context.stroke();
        context.setLineDash([]);
        context.beginPath();
        context.arc(gx, gy, (chases ? 6 : 3) * ratio, 0, 2 * Math.PI);
        context.stroke();
      });
    }
    if (shows("found")) {
      for (const box of rowsAt(lists.found, frame)) boxOf(box, "faint-ink", 1, box.ally ? [2, 3] : []);
    }
    if (shows("truth")) {
      for (const truth of rowsAt(lists.truths, frame)) boxOf(truth, "intruder", truth.counts ? 1.5 : 0.75);
    }
    robots.forEach((robot) => {
      if (robot.here) drawRobot(context, robot, px, py, view.scale, ratio, shows("believed"));
    });
    const signed = []; // errors that may have their cause beside them
    if (shows("boxes")) {
      const errors = errorsAt(head, lists, frame);
      for (const box of rowsAt(lists.detections, frame)) if (box.truth) boxOf(box, "detection", 2);
      for (const truth of rowsAt(lists.truths, frame)) {
        if (truth.counts || truth.detection) continue;
        const [x, y, w, h] = sides(truth);
        line("faint-ink", 1, [3, 3]);
        context.beginPath();
        context.arc(x + w / 2, y + h / 2, Math.max(9 * ratio, Math.hypot(w, h) / 2), 0, 2 * Math.PI);
        context.stroke();
      }
      errors.forEach((error) => {
        const [x, y, w, h] = sides(error.box);
        const [cx, cy] = [x + w / 2, y + h / 2];
        const reach = Math.max(9 * ratio, h / 2 + 4 * ratio);
        if (error.kind === "miss") {
          drawMiss(context, cx, cy, Math.max(9 * ratio, w / 2 + 4 * ratio), reach, ratio, line);
        } else if (error.kind === "fragment") {
          boxOf(error.box, "detection", 2, [5, 4]);
        } else {
          boxOf(error.box, "false-detection", 2);
          context.beginPath();
          context.moveTo(x, y);
          context.lineTo(x + w, y + h);
          context.moveTo(x + w, y);
          context.lineTo(x, y + h);
          context.stroke();
        }
        signed.push([causeOf(error), cx, cy, reach]);
      });
    }
    drawScale(context, view.scale, ratio, words);
    const late = head.events.filter(([at]) => at <= frame + 1 && frame + 1 < at + 3 * head.hz);
    late.forEach(([, , text], number) => words(text, [[canvas.width / 2, (16 + 18 * number) * ratio]], "ink"));
    if (!shows("names")) return;
    robots.forEach((robot) => {
      if (!robot.here) return;
      const { guard, name } = head.robots[robot.robot];
      const up = Math.max(LEAST_PX * ratio, 0.14 * view.scale) + 4 * ratio;
      const [x, y] = [px(robot.x * STEP_M), py(robot.y * STEP_M)];
      const spots = [[x + up, y - up / 2], [x - up, y - up / 2], [x + up, y + up / 2], [x - up, y + up / 2]];
      words(name.match(/\d+$/)?.[0] || name, spots, guard ? "guard" : "intruder");
    });
    for (const [cause, x, y, reach] of signed) {
      const off = reach + 9 * ratio;
      if (cause) words(cause, [[x, y + off], [x, y - off], [x, y + 1.8 * off], [x, y - 1.8 * off]], "ink");
    }
  }

  /** The four corners of the box that is not there, and a disc with an exclamation mark. */
  function drawMiss(context, cx, cy, halfX, halfY, ratio, line) {
    line("missed", 2);
    context.beginPath();
    for (const [x, y] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) {
      context.moveTo(cx + x * 0.55 * halfX, cy + y * halfY);
      context.lineTo(cx + x * halfX, cy + y * halfY);
      context.lineTo(cx + x * halfX, cy + y * 0.55 * halfY);
    }
    context.stroke();
    context.beginPath();
    context.arc(cx - halfX, cy - halfY, 6 * ratio, 0, 2 * Math.PI);
    context.fillStyle = colours.missed;
    context.fill();
    context.font = `800 ${10 * ratio}px system-ui, sans-serif`;
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillStyle = colours.floor;
    context.fillText("!", cx - halfX, cy - halfY + 0.5 * ratio);
  }

  /** Each guard's local costmap about its believed position, and the usable range of its LiDAR. */
  function drawReach(context, robots, px, py, scale, line) {
    const { window: side, range, sensor } = now.head;
    for (const robot of robots) {
      if (!robot.here || !now.head.robots[robot.robot].guard) continue;
      const [x, y, yaw] = [robot.x * STEP_M, robot.y * STEP_M, robot.yaw * STEP_M];
      if (range) {
        line("guard-range", 1);
        context.beginPath();
        const ahead = sensor[0] * Math.cos(yaw) - sensor[1] * Math.sin(yaw);
        const aside = sensor[0] * Math.sin(yaw) + sensor[1] * Math.cos(yaw);
        context.arc(px(x + ahead), py(y + aside), range * scale, 0, 2 * Math.PI);
        context.stroke();
      }
      if (side) {
        line("guard", 1);
        const [left, top] = [x + robot.off_x * STEP_M - side / 2, y + robot.off_y * STEP_M + side / 2];
        context.strokeRect(px(left), py(top), side * scale, side * scale);
      }
    }
  }

  /** A bar of a round length at the lower right. */
  function drawScale(context, scale, ratio, words) {
    const length = SCALES_M.find((one) => one * scale >= 44 * ratio) || SCALES_M.at(-1);
    const [right, y] = [canvas.width - 10 * ratio, canvas.height - 8 * ratio];
    for (const [colour, width] of [["floor", 6], ["ink", 3]]) {
      context.fillStyle = colours[colour];
      context.fillRect(right - length * scale, y - (width * ratio) / 2, length * scale, width * ratio);
    }
    words(`${length} m`, [[right - (length * scale) / 2, y - 12 * ratio]], "ink");
  }

  function drawScans(context, px, py, ratio) {
    const { head, scans, frame } = now;
    const sensors = rowsAt(scans.sensors, frame);
    const start = scans.beams.start[frame];
    const each = (scans.beams.start[frame + 1] - start) / Math.max(1, sensors.filter((one) => one.here).length);
    let beam = start;
    context.fillStyle = colours["guard-faint"];
    for (const sensor of sensors.filter((one) => one.here)) {
      for (let i = 0; i < each; i++, beam++) {
        const steps = scans.beams.rows.range[beam];
        if (steps > 127) continue;
        const range = steps * head.beams[2];
        const angle = sensor.yaw * STEP_M + head.beams[0] + i * head.beams[1];
        const x = px(sensor.x * STEP_M + range * Math.cos(angle)), y = py(sensor.y * STEP_M + range * Math.sin(angle));
        context.fillRect(x - 1.2 * ratio, y - 1.2 * ratio, 2.4 * ratio, 2.4 * ratio);
      }
    }
  }

  function drawRobot(context, robot, px, py, scale, ratio, showsGhost) {
    const { body } = now.head;
    const { guard } = now.head.robots[robot.robot];
    const long = Math.max(...body.map(([x]) => x)) - Math.min(...body.map(([x]) => x));
    const enlarged = Math.max(1, (LEAST_PX * ratio) / (long * scale));
    const outline = (x, y, yaw) => {
      const [c, s] = [Math.cos(yaw * STEP_M), Math.sin(yaw * STEP_M)];
      context.beginPath();
      for (const [bx, by] of body) {
        const [ex, ey] = [bx * enlarged, by * enlarged];
        context.lineTo(px(x * STEP_M + c * ex - s * ey), py(y * STEP_M + s * ex + c * ey));
      }
      context.closePath();
      return [px(x * STEP_M), py(y * STEP_M), c, -s];
    };
    const [x, y, c, s] = outline(robot.x, robot.y, robot.yaw);
    context.fillStyle = colours[guard ? "guard" : "intruder"];
    context.fill();
    context.strokeStyle = colours.floor;
    context.lineWidth = ratio;
    context.setLineDash([]);
    context.stroke();
    const ahead = (long * scale * enlarged) / 2 + 6 * ratio;
    context.strokeStyle = colours[guard ? "guard" : "intruder"];
    context.lineWidth = 2 * ratio;
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(x + c * ahead, y + s * ahead);
    context.stroke();
    if (showsGhost && guard && (robot.off_x || robot.off_y || robot.off_yaw)) {
      outline(robot.x + robot.off_x, robot.y + robot.off_y, robot.yaw + robot.off_yaw);
      context.strokeStyle = colours.ink;
      context.lineWidth = ratio;
      context.setLineDash([2 * ratio, 2 * ratio]);
      context.stroke();
    }
  }

  function drawStrip() {
    const context = strip.getContext("2d");
    const { width, height } = strip;
    const at = (frame) => (frame / now.head.frames) * width;
    context.clearRect(0, 0, width, height);
    for (const { one } of now.shown) {
      const isMiss = one.kind === "miss";
      context.fillStyle = colours[{ miss: "missed", false: "false-detection", fragment: "detection" }[one.kind]];
      context.globalAlpha = 0.6;
      context.fillRect(at(one.first), isMiss ? 0 : height / 2, Math.max(1, at(one.last + 1) - at(one.first)), height / 2 - 1);
    }
    context.globalAlpha = 1;
    context.fillStyle = colours.ink;
    context.fillRect(at(now.frame) - 1, 0, 2, height);
  }

  /** One-to-one F1 over the last ten seconds as a line, with that of all frames so far as a thicker one. */
  function drawCurve() {
    const context = curve.getContext("2d");
    const ratio = window.devicePixelRatio || 1;
    const { width, height } = curve;
    const { head, totals } = now;
    const top = 4 * ratio, base = height - 4 * ratio;
    const at = (frame) => ((frame + 0.5) / head.frames) * width;
    context.clearRect(0, 0, width, height);
    context.strokeStyle = colours.line;
    context.lineWidth = ratio;
    context.beginPath();
    for (const share of [0, 0.5, 1]) {
      context.moveTo(0, base - share * (base - top));
      context.lineTo(width, base - share * (base - top));
    }
    context.stroke();
    const recent = Math.round(10 * head.hz);
    for (const [score, colour, thick] of [
      [(frame) => recentF1(totals, frame, recent), "guard", 1],
      [(frame) => f1(totals, frame), "ink", 2],
    ]) {
      context.strokeStyle = colours[colour];
      context.lineWidth = thick * ratio;
      context.beginPath();
      for (let frame = 0; frame < head.frames; frame++) {
        const value = score(frame);
        if (value !== null) context.lineTo(at(frame), base - value * (base - top));
      }
      context.stroke();
    }
    context.font = `${11 * ratio}px system-ui, sans-serif`;
    context.textBaseline = "bottom";
    context.lineWidth = 3 * ratio;
    context.strokeStyle = colours.paper;
    context.fillStyle = colours.soft;
    const text = "one-to-one F1, 0 to 1: so far (thick), last 10 s (thin)";
    context.strokeText(text, 3 * ratio, base - ratio);
    context.fillText(text, 3 * ratio, base - ratio);
    context.fillStyle = colours.ink;
    context.fillRect(at(now.frame) - 1, 0, 2, height);
  }

  // ---- wiring

  async function follow(hash) {
    const asked = parseHash(hash);
    if (asked.trial === undefined || asked.trial >= trials.length) return false;
    pause();
    $("cell").value = trials[asked.trial].cell;
    fillSeeds($("cell").value);
    $("seed").value = asked.trial;
    if (asked.trial !== now.trial) await load(asked.trial, 0);
    if (asked.cause) {
      $("cause").value = asked.cause;
      if (!$("cause").value) $("cause").value = "all";
      fillErrors();
    }
    const frame = (asked.frame || 1) - 1;
    now.focus = now.episodes.find((one) => one.first <= frame && frame <= one.last && isChosen(one)) || null;
    go(frame);
    section.scrollIntoView();
    canvas.focus({ preventScroll: true });
    if (asked.play) play();
    return true;
  }

  readColours();
  fillCells();
  fillSeeds(trials[0].cell);
  $("cell").addEventListener("change", () => { pause(); fillSeeds($("cell").value); load(Number($("seed").value), 0); });
  $("seed").addEventListener("change", () => { pause(); load(Number($("seed").value), 0); });
  $("cause").addEventListener("change", () => { fillErrors(); tell(); });
  $("play").addEventListener("click", toggle);
  $("back").addEventListener("click", KEYS[","]);
  $("forward").addEventListener("click", KEYS["."]);
  $("next").addEventListener("click", KEYS.n);
  $("previous").addEventListener("click", KEYS.p);
  $("zoom").addEventListener("change", () => draw());
  scrub.addEventListener("input", () => { pause(); go(Number(scrub.value) - 1); });
  for (const one of [strip, curve]) {
    one.addEventListener("click", (event) => {
      pause();
      go(Math.floor((event.offsetX / one.clientWidth) * now.head.frames));
    });
  }
  for (const box of document.querySelectorAll("#layers input")) box.addEventListener("change", draw);
  document.addEventListener("keydown", onKey);
  window.addEventListener("hashchange", () => follow(location.hash));
  const again = () => { if (now.head) { size(); draw(); drawStrip(); drawCurve(); } };
  window.addEventListener("resize", again);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { readColours(); again(); });
  follow(location.hash).then((found) => found || load(0, 0)).then(() => { section.dataset.ready = "true"; });
})();

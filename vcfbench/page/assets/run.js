"use strict";
// The page of one run: listens to what happens, draws it, and keeps what it has when the run, or the server, is gone.

const base = location.pathname.replace(/\/$/, "");
const token = location.hash.slice(1);
const isLive = base.endsWith("/live");
const MOST = 3000;
const FOLDED_FROM = 24;

const run = { about: {}, planned_s: null, headings: [], steps: [], points: [], lines: [], log: [], t_s: 0, end: null, doing: null, heard_ms: 0, count: 0 };
let zoomed = null;
let source = null;
let asking = false;
let askAgain = false;

// The unit of the output, and that of its small differences with the factor.
const unit = () => run.about.unit || "V";
const small = () => (unit() === "V" ? [1e3, "mV"] : [1, unit()]);
const perRate = (of) => (of.includes("/") ? `(${of})/(deg/s)` : `${of}/(deg/s)`);

// ---- plots

const timeChart = new Chart(byId("readings"), 260, (many) => ({
  scales: { x: { time: false } },
  axes: [axis("bench time / s"), leftAxis(`output / ${unit()}`)],
  cursor: { drag: { x: true, y: false, setScale: false } },
  series: [{ label: "t / s", value: (_, t) => (t === null ? "–" : t.toFixed(1)) },
    many === "many" ? { ...line(`readings / ${unit()}`, 0, 6), spanGaps: false } : marks(`reading / ${unit()}`, 0, 4, 6)],
  hooks: {
    setSelect: [(plot) => {
      if (plot.select.width < 8) return;
      zoomed = [plot.posToVal(plot.select.left, "x"), plot.posToVal(plot.select.left + plot.select.width, "x")];
      plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
      byId("whole").hidden = false;
      fetchReadings();
    }],
  },
}));

const stepName = (step) => `step ${step}`;
const steps = () => [...new Set(run.points.map((point) => point.step))];
const lineOf = (step) => run.lines.find((each) => each.step === step);

const pointsChart = new Chart(byId("points"), 320, () => ({
  scales: { x: { time: false } },
  axes: [axis("rate / (deg/s)"), leftAxis(`output / ${unit()}`)],
  cursor: { drag: { x: true, y: true } },
  series: [{ label: "rate", value: (_, x) => (x === null ? "–" : signed(x, 3)) },
    ...steps().flatMap((step, place) => [marks(`${stepName(step)} / ${unit()}`, place, 7, 5), ...(lineOf(step) ? [line("its line", place, 5)] : [])])],
}));

const residualsChart = new Chart(byId("residuals"), 220, () => ({
  scales: { x: { time: false } },
  axes: [axis("rate / (deg/s)"), leftAxis("residual of the span / ppm")],
  cursor: { drag: { x: true, y: true } },
  hooks: { drawAxes: [zeroLine] },
  series: [{ label: "rate", value: (_, x) => (x === null ? "–" : signed(x, 3)) },
    ...run.lines.map((each) => marks(`${stepName(each.step)} / ppm`, steps().indexOf(each.step), 7, 0))],
}));

function ppmOfSpan(fit) {
  const rates = fit.points.map((number) => run.points[number].rate_deg_s);
  return 1e6 / (Math.abs(fit.scale_factor) * (Math.max(...rates) - Math.min(...rates)));
}

function drawPoints() {
  const order = run.points.map((_, number) => number).sort((a, b) => run.points[a].rate_deg_s - run.points[b].rate_deg_s);
  const x = order.map((number) => run.points[number].rate_deg_s);
  const data = [x];
  for (const step of steps()) {
    data.push(order.map((number) => (run.points[number].step === step ? run.points[number].output_v : null)));
    const fit = lineOf(step);
    if (fit) {
      const own = fit.points.map((number) => run.points[number].rate_deg_s);
      const low = Math.min(...own), high = Math.max(...own);
      data.push(x.map((rate) => (rate >= low && rate <= high ? fit.bias + fit.scale_factor * rate : null)));
    }
  }
  const key = steps().map((step) => `${step}${lineOf(step) ? "L" : ""}`).join();
  if (x.length) pointsChart.draw(key, data);
  const residuals = [];
  for (const fit of run.lines) fit.points.forEach((number, place) => residuals.push([run.points[number].rate_deg_s, fit, ppmOfSpan(fit) * fit.residuals_v[place]]));
  residuals.sort((a, b) => a[0] - b[0]);
  if (residuals.length) {
    residualsChart.draw(run.lines.map((each) => each.step).join(),
      [residuals.map((each) => each[0]), ...run.lines.map((fit) => residuals.map((each) => (each[1] === fit ? each[2] : null)))]);
  } else byId("residuals").textContent = run.end ? "No step of this run has points at three rates." : "From the third rate of a calibration on.";
  if (!x.length) byId("points").textContent = run.end ? "This procedure measured no points." : "No point is measured yet.";
  byId("lines").replaceChildren(...run.lines.map((fit) => made("p",
    `${stepName(fit.step)}: ${signed(small()[0] * fit.scale_factor, 5)} ${perRate(small()[1])}, ${signed(small()[0] * fit.bias, 3)} ${small()[1]} through ${fit.points.length} points`)));
  drawRows();
}

function drawRows() {
  if (!byId("rows-holder").open) return;
  const residual = new Map();
  for (const fit of run.lines) fit.points.forEach((number, place) => residual.set(number, signed(ppmOfSpan(fit) * fit.residuals_v[place], 0)));
  const columns = ["step", "rate / (deg/s)", "V_Vc / V", `output / ${unit()}`, `s / ${small()[1]}`, "n", "residual / ppm"].map((head) => ({ head, align: "right" }));
  const rows = run.points.map((p, number) => [p.step, signed(p.rate_deg_s, 4), signed(p.v_vc_v, 5), signed(p.output_v, 5), (small()[0] * p.std_v).toFixed(3), p.n, residual.get(number) || "–"]);
  byId("rows").replaceChildren(tableOf({ columns, rows, title: "" }));
}

async function fetchReadings() {
  if (!run.count) return;
  if (asking) { askAgain = true; return; }
  asking = true;
  askAgain = false;
  const part = zoomed ? `&from=${zoomed[0]}&to=${zoomed[1]}` : "";
  try {
    const answer = await fetch(`${base}/readings?most=${MOST}${part}`);
    if (answer.ok) drawReadings(await answer.json());
  } catch { /* the server is gone: what is drawn stays */ }
  asking = false;
  if (askAgain) fetchReadings();
}

function drawReadings(drawn) {
  if (!drawn.t_s.length) { byId("readings").textContent = "No reading is there."; return; }
  timeChart.draw(drawn.all && drawn.t_s.length <= 1500 ? "few" : "many", [drawn.t_s, drawn.v]);
  const as = drawn.all ? "" : ", drawn as the least and largest of each stretch";
  byId("readings-said").textContent = `${drawn.shown.toLocaleString("en")} of ${drawn.count.toLocaleString("en")}${as}`;
}

// ---- words

function drawState(bench) {
  const [demanded, read] = bench.table.replace(/^table /, "").split(", ");
  byId("table").textContent = demanded + (read && !demanded.includes("deg") ? " deg/s" : "");
  byId("table-read").textContent = read || "\u00a0";
  byId("rails").textContent = bench.rails.replace(/^rails /, "").replace(/(\d) ([-+])/, "$1, $2");
  byId("v_vc").textContent = bench.v_vc.replace(/^V_Vc /, "");
}

function drawAbout() {
  const about = run.about;
  byId("title").textContent = about.procedure || "";
  byId("sentence").textContent = about.title || "";
  byId("what").textContent = [about.run, about.bench && `bench ${about.bench}`, about.simulated ? "simulated" : ""].filter(Boolean).join(" · ");
  document.title = `${about.procedure || "run"} – vcfbench`;
  byId("limits").replaceChildren(...(about.limits || []).flatMap(([name, value]) => [made("dt", name), made("dd", value)]));
}

const waits = () => run.control === "pausing" || run.control === "paused";

function drawProgress() {
  if (run.end || !run.about.run || !connected) return;
  const since = (performance.now() - run.heard_ms) / 1e3 / (run.pace || 1);
  // of a run in another process steps are known when they are done
  const t = run.t_s + (isLive ? Math.min(since, run.doing ? run.doing.duration_s : 0) : since);
  const state = run.control && run.control !== "beginning" ? run.control : "running";
  byId("status").textContent = state;
  byId("status").className = `pill ${state === "running" ? "running" : "marginal"}`;
  byId("pause").hidden = !(isLive && token) || state === "stopping";
  byId("pause").textContent = waits() ? "Go on" : "Pause";
  byId("going").hidden = false;
  byId("look").hidden = isLive && Boolean(token);
  byId("look").textContent = isLive
    ? "This address can only look. The address that the terminal of the run shows can stop it."
    : "This run goes on in a process of its own. It can be stopped only there: Ctrl-C in its terminal makes the bench safe.";
  if (run.planned_s) {
    const begun = run.began_s;
    const done = Math.min(1, (t - begun) / run.planned_s);
    const left = Math.max(0, run.planned_s - (t - begun)) * (run.pace || 1);
    const ends = new Date(Date.now() + left * 1e3).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", hour12: false });
    byId("bar").style.width = `${100 * done}%`;
    byId("percent").textContent = `${Math.floor(100 * done)} %`;
    byId("left").textContent = `${span(left)} left, ends ${ends}`;
  } else {
    byId("percent").textContent = span(t);
    byId("left").textContent = "of bench time so far; when it ends is not in the record";
  }
}

function drawSteps() {
  const groups = [];
  for (const step of run.steps) {
    if (step.kind === "heading") groups.push({ heading: step.what, steps: [], failed: false });
    else {
      if (!groups.length) groups.push({ heading: "Before the plan", steps: [], failed: false });
      const last = groups[groups.length - 1];
      last.steps.push(step);
      last.failed = last.failed || step.kind === "failed";
    }
  }
  const opened = new Set([...document.querySelectorAll("#steps details[open]")].map((each) => each.dataset.place));
  const items = groups.map((group, place) => {
    const isNow = place === groups.length - 1 && !run.end;
    const item = made("li", null, group.failed ? "failed" : isNow ? "now" : "done");
    const details = made("details");
    details.dataset.place = place;
    details.open = opened.has(String(place));
    details.append(made("summary", group.heading));
    const list = made("ol");
    for (const step of group.steps.slice(-200)) {
      const line = made("li", `${span(step.t_s)}  ${step.what}`);
      if (step.result) line.append(" → ", made("b", step.result));
      list.append(line);
    }
    if (isNow && run.doing) list.append(made("li", run.doing.what, "now"));
    details.append(list);
    item.append(details);
    return item;
  });
  const coming = run.end ? [] : run.headings.slice(groups.filter((each) => each.heading !== "Before the plan").length);
  byId("steps").replaceChildren(...items, ...coming.map((heading) => { const item = made("li", null, "next"); item.append(made("span", heading)); return item; }));
}

function drawLog() {
  const list = byId("log");
  const atEnd = list.scrollTop + list.clientHeight >= list.scrollHeight - 8;
  list.replaceChildren(...run.log.slice(-300).map((each) => {
    const line = made("li", null, each.kind);
    line.append(made("time", span(each.t_s)), each.what);
    return line;
  }));
  if (atEnd) list.scrollTop = list.scrollHeight;
}

function figureOf(part) {
  const holder = made("div", null, "chart");
  holder.append(made("h4", part.title));
  const plotted = made("div");
  holder.append(plotted);
  requestAnimationFrame(() => {
    const rows = part.series.flatMap((series, place) => series.x.map((x, number) => [x, place, series.y[number]])).sort((a, b) => a[0] - b[0]);
    const data = [rows.map((row) => row[0]), ...part.series.map((_, place) => rows.map((row) => (row[1] === place ? row[2] : null)))];
    const scale = (log) => (log ? { distr: 3 } : {});
    new Chart(plotted, 280, () => ({
      scales: { x: { time: false, ...scale(part.x.log) }, y: scale(part.y.log) },
      axes: [axis(part.x.title), leftAxis(part.y.title)],
      series: [{ label: part.x.title, value: (_, x) => (x === null ? "–" : x.toPrecision(5)) },
        ...part.series.map((series, place) => ({ ...(series.kind === "points" ? marks(series.label, place, 6, 6) : line(series.label, place, 6)),
          value: (_, y) => (y === null || y === undefined ? "–" : y.toPrecision(6)) }))],
    })).draw("figure", data);
  });
  return holder;
}

function drawEnd() {
  const end = run.end;
  byId("going").hidden = true;
  byId("look").hidden = true;
  byId("stop").hidden = byId("pause").hidden = true;
  byId("status").textContent = end.status;
  byId("status").className = `pill ${end.status}`;
  document.querySelector(".tiles").hidden = true;
  const record = end.record ? ` Record: ${end.record}` : "";
  const words = end.error ? `The run is over (${end.status}): ${end.error}` : `The run is over: ${end.status}.`;
  byId("over").textContent = words + record;
  byId("over").className = `banner ${end.status === "complete" ? { fail: "bad", marginal: "warn" }[end.verdict] ?? "good" : "bad"}`;
  byId("over").hidden = false;
  if (!end.parts) return;
  if (!isLive) { byId("report").href = `${base}/report`; byId("report").hidden = false; }
  byId("results").hidden = !end.parts.length;
  byId("verdict").replaceChildren();
  if (end.verdict) byId("verdict").append(made("span", `verdict: ${end.verdict}`, `pill ${end.verdict}`));
  byId("parts").replaceChildren(...end.parts.map((part) => {
    if (part.part === "heading") return made(`h${Math.min(4, part.level + 2)}`, part.text);
    if (part.part === "text") return made("pre", part.text);
    if (part.part === "figure") return figureOf(part);
    if (part.part === "notice") return made("p", part.text, `banner ${{ pass: "good", marginal: "warn", fail: "bad" }[part.kind] ?? ""}`);
    const holder = made("div", null, "scroll");
    holder.append(tableOf(part));
    if (part.rows.length <= FOLDED_FROM) return holder;
    const folded = made("details");
    folded.append(made("summary", `${part.title || "Table"}: ${part.rows.length} rows`), holder);
    return folded;
  }));
}

// ---- what comes

function take(news) {
  connected = true;
  if (news.about && run.about.run && news.about.run !== run.about.run) { location.reload(); return; } // the next of a sitting
  if (!run.end && (news.about || run.about.run)) {
    byId("over").hidden = true;
    byId("stop").hidden = !(isLive && token);
  }
  if (news.about) {
    run.steps = []; run.log = []; run.points = []; run.lines = [];
    Object.assign(run, { about: news.about, planned_s: news.planned_s, headings: news.headings });
    drawAbout();
  }
  const now = performance.now();
  if (run.seen_ms === undefined && (news.doing || !isLive)) { run.seen_ms = now; run.seen_s = news.t_s; }
  if (run.seen_ms !== undefined && news.t_s - run.seen_s > 2) run.pace = (now - run.seen_ms) / 1e3 / (news.t_s - run.seen_s);
  if (run.began_s !== undefined && news.began_s !== run.began_s) run.seen_ms = undefined; // it paused: the pace is taken anew
  run.began_s = news.began_s;
  Object.assign(run, { t_s: news.t_s, doing: news.doing, control: news.control, end: news.end, heard_ms: now });
  if (!run.end && news.doing) byId("doing").textContent = news.doing.what;
  else if (!run.end && run.control === "paused") byId("doing").textContent = "paused: table at rest, V_Vc off, rails on";
  else if (!run.end && !isLive && news.steps.length) byId("doing").textContent = `done: ${news.steps[news.steps.length - 1].what}`;
  if (!run.end) byId("reading").textContent = news.last_v === null ? "\u00a0" : `last reading ${signed(news.last_v, 6)} V`;
  drawState(news.bench);
  if (news.steps.length || news.about) { run.steps.push(...news.steps); }
  drawSteps();
  if (news.log.length) { run.log.push(...news.log); drawLog(); }
  if (news.points) { run.points = news.points; run.lines = news.lines; drawPoints(); }
  else if (news.about || run.end) drawPoints();
  const grown = news.readings !== run.count;
  run.count = news.readings;
  if (news.drawn && !zoomed) drawReadings(news.drawn);
  else if (grown) soonReadings();
  drawProgress();
  if (run.end) drawEnd();
}

let waiting = null;
function soonReadings() {
  if (waiting === null) waiting = setTimeout(() => { waiting = null; if (!run.end || zoomed) fetchReadings(); }, run.drawnOnce ? 1000 : 0);
  run.drawnOnce = true;
}

let connected = false;
const SILENT_MS = 30e3; // the program says something every 10 s, were it only that it is there
let said_ms = performance.now();

function listen() {
  said_ms = performance.now();
  source = new EventSource(`${base}/events`);
  source.addEventListener("news", (event) => { said_ms = performance.now(); const news = JSON.parse(event.data); if (news) take(news); });
  source.addEventListener("last", (event) => {
    source.close();
    const news = JSON.parse(event.data);
    const known = run.end && run.end.parts && news && news.about && news.about.run === run.about.run;
    if (news && !known) take(news);
    if (!run.end) lost();
    if (isLive) setTimeout(listen, 2000); // another run may begin here
  });
  source.onerror = () => {
    if (!run.end && source.readyState !== EventSource.OPEN) lost();
    if (source.readyState === EventSource.CLOSED && (isLive || !run.end)) setTimeout(listen, 2000); // it does not try again by itself
  };
}

function lost() {
  connected = false;
  byId("status").textContent = "no connection";
  byId("status").className = "pill lost";
  byId("over").textContent = "The command that measured does not answer any more; it is asked again. What is shown is what came so far; the record has all of it. The run may go on: Stop is tried, and says whether it was heard.";
  byId("over").className = "banner bad";
  byId("over").hidden = false;
}

// ---- stop, pause, go on

const asked = async (what) => {
  const given = { method: "POST", headers: { "X-Vcfbench-Token": token }, signal: AbortSignal.timeout(5000) };
  let answer;
  try {
    answer = await fetch(`${base}/${what}?run=${encodeURIComponent(run.about.run || "")}`, given);
  } catch {
    throw new Error("no answer came, so it may have been heard or not; try again, or stop it at the bench");
  }
  if (!answer.ok) throw new Error(await answer.text());
};

if (isLive && token) {
  byId("pause").addEventListener("click", async () => {
    byId("pause").disabled = true;
    try {
      await asked(waits() ? "go-on" : "pause");
    } catch (error) {
      byId("status").textContent = `not done: ${error.message}`;
    }
    byId("pause").disabled = false;
  });
  byId("stop").hidden = false;
  byId("stop").addEventListener("click", () => byId("sure").showModal());
  byId("sure").addEventListener("close", async () => {
    if (byId("sure").returnValue !== "yes") return;
    byId("stop").disabled = true;
    byId("stop").textContent = "stopping …";
    try {
      await asked("stop");
    } catch (error) {
      byId("stop").disabled = false;
      byId("stop").textContent = `not stopped: ${error.message}`;
    }
  });
}
byId("whole").addEventListener("click", () => { zoomed = null; byId("whole").hidden = true; fetchReadings(); });
byId("rows-holder").addEventListener("toggle", drawRows);
setInterval(drawProgress, 1000);
setInterval(() => { // a connection that nobody has closed, as after a sleep, is noticed by its silence alone
  if (source.readyState !== EventSource.OPEN || performance.now() - said_ms < SILENT_MS) return;
  source.close();
  if (!run.end) lost();
  listen();
}, 1000);
listen();

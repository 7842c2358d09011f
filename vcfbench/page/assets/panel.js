"use strict";
// The operator's panel: name a device, mount it, start, watch, read the verdict. Enter does what is next; so does a scanner.

const token = location.hash.slice(1);
const COLOURS = { PASS: "good", MARGINAL: "warn", DONE: "" };
let state = null;
let wantsAnother = false;
let lost = false;

async function asked(path, words) {
  const answer = await fetch(path, { method: "POST", headers: { "X-Vcfbench-Token": token }, body: words || "" });
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}

async function act(path, words) {
  try {
    const next = await asked(path, words);
    problem("");
    if (next.batch) take(next);
    return true;
  } catch (error) {
    problem(error.message);
    return false;
  }
}

const control = (what) => act(`/run/live/${what}?run=${encodeURIComponent(state.run.run)}`);

function problem(words) {
  byId("problem").textContent = words;
  byId("problem").hidden = !words;
}

function show(id, visible, focus) {
  const came = visible && byId(id).hidden;
  byId(id).hidden = !visible;
  if (came && focus) byId(focus).focus();
}

function take(next) {
  const before = state && state.state;
  state = next;
  if (before !== state.state) wantsAnother = false;
  const at = state.state, run = state.run;
  byId("batch").textContent = `Batch ${state.batch}`;
  byId("bench").textContent = [`bench ${state.bench}${state.simulated ? " (simulated)" : ""}`, state.operator, token ? "" : "this address can only look"].filter(Boolean).join(" · ");
  for (const each of document.querySelectorAll(".named")) each.textContent = state.serial;
  byId("procedures").textContent = `It gets: ${state.procedures.join(", ")}.`;
  const naming = at === "serial" || at === "verdict" || (at === "mounting" && wantsAnother);
  show("verdict-card", Boolean(state.verdict));
  show("next", naming && Boolean(token), "serial");
  show("mounting", at === "mounting" && !naming, "start");
  show("measuring", at === "measuring" || at === "asking");
  show("asking", at === "asking", "answer");
  byId("asked").textContent = state.asked;
  byId("starting").hidden = byId("answering").hidden = !token;
  if (state.verdict) drawVerdict(state.verdict);
  drawLeft();
  drawRun(run);
  byId("sheet-card").hidden = !state.sheet.length;
  byId("sheet").replaceChildren(...state.sheet.map((part) => (part.part === "table" ? tableOf(part) : made(part.part === "heading" ? "h3" : "p", part.text))));
  document.title = `${state.serial || state.batch}: ${state.verdict ? state.verdict.word : at} – vcfbench`;
}

function drawVerdict(verdict) {
  byId("verdict").textContent = verdict.word;
  byId("verdict").className = COLOURS[verdict.word] ?? "bad";
  byId("why").textContent = `${state.serial}${verdict.why ? `: ${verdict.why}` : ""}`;
  byId("record").hidden = !verdict.run;
  byId("record").href = `/run/${encodeURIComponent(verdict.run || "")}`;
}

function drawLeft() {
  byId("left").replaceChildren(...state.left.map((serial) => {
    const button = made("button", serial);
    button.type = "button";
    button.addEventListener("click", () => act("/panel/name", serial));
    return button;
  }));
}

function drawRun(run) {
  const goes = Boolean(run), waits = goes && (run.control === "pausing" || run.control === "paused");
  byId("stop").disabled = !goes || !token || run.control === "stopping";
  byId("pause").disabled = byId("stop").disabled;
  byId("pause").textContent = waits ? "Go on" : "Pause";
  if (!goes) return;
  const part = run.planned_s ? Math.min(1, run.t_s / run.planned_s) : 0;
  byId("which").textContent = `${run.procedure}${run.of > 1 ? `, run ${run.number} of ${run.of}` : ""}${run.control && run.control !== "running" && run.control !== "beginning" ? `: ${run.control}` : ""}`;
  byId("bar").style.width = `${100 * part}%`;
  byId("progress").textContent = run.planned_s ? `${Math.floor(100 * part)} %, ${span(run.planned_s - run.t_s)} of bench time left` : "";
  byId("doing").textContent = run.doing;
}

byId("naming").addEventListener("submit", async (event) => {
  event.preventDefault();
  const typed = byId("serial");
  if (await act("/panel/name", typed.value)) wantsAnother = false;
  typed.value = "";
});
byId("starting").addEventListener("submit", (event) => { event.preventDefault(); act("/panel/start"); });
byId("answering").addEventListener("submit", async (event) => {
  event.preventDefault();
  if (await act("/panel/answer", byId("answer").value)) byId("answer").value = "";
});
byId("other").addEventListener("click", () => { wantsAnother = true; take(state); });
byId("pause").addEventListener("click", () => control(byId("pause").textContent === "Pause" ? "pause" : "go-on"));
byId("stop").addEventListener("click", () => control("stop"));

async function look() {
  try {
    const answer = await fetch("/panel/state");
    if (answer.ok) take(await answer.json());
    if (lost) problem("");
    lost = false;
  } catch {
    lost = true;
    problem("The panel's command does not answer any more; it is asked again. What is shown is what was known last.");
  }
  setTimeout(look, 500);
}
look();

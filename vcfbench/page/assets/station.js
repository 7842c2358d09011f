"use strict";
// The station's page: its runs, newest first, and its devices; looked at again every few seconds.

let listed = { runs: [], devices: [] };

function pill(text) { const cell = made("td"); if (text) cell.append(made("span", text, `pill ${text}`)); return cell; }

function row(each) {
  const line = made("tr", null, each.verdict), began = made("td", null, "nowrap"), link = made("a", when(each.began_utc) || each.run);
  link.href = `/run/${encodeURIComponent(each.run)}`;
  link.title = each.run;
  began.append(link);
  const values = made("td", each.problem || "");
  for (const value of each.values || []) {
    const key = made("span", null, "key");
    key.append(made("i", `${value.name} `), value.words);
    values.append(key);
  }
  line.append(began, made("td", each.procedure, "nowrap"), made("td", each.dut), pill(each.status), pill(each.verdict), values,
    made("td", each.bench ? `${each.bench}${each.simulated ? " (simulated)" : ""}` : "", "nowrap"));
  return line;
}

function when(utc) {
  if (!utc) return "";
  const time = new Date(utc);
  return isNaN(time) ? utc : time.toLocaleString("sv").slice(0, 16);
}

function draw() {
  const wanted = byId("find").value.trim().toLowerCase().split(/\s+/).filter(Boolean);
  const fits = (each) => { const words = [each.run, each.procedure, each.dut, each.status, each.verdict, each.bench].join(" ").toLowerCase(); return wanted.every((word) => words.includes(word)); };
  const shown = listed.runs.filter(fits);
  document.querySelector("#runs tbody").replaceChildren(...shown.map(row));
  byId("said").textContent = `${listed.runs.length} ${listed.runs.length === 1 ? "run" : "runs"}, ${listed.devices.length} ${listed.devices.length === 1 ? "device" : "devices"}`;
  byId("older").textContent = listed.older ? `${listed.older} older runs are not shown; vcfbench runs list has them` : shown.length ? "" : "no run";
  byId("live").hidden = !listed.live;
}

function drawBatches() {
  const names = [...new Set(listed.runs.map((each) => each.batch).filter(Boolean))];
  byId("batches").hidden = !names.length;
  document.querySelector("#batches ul").replaceChildren(...names.map((name) => {
    const line = made("li", `${name}: `);
    for (const [kind, words] of [["html", "sheet"], ["pdf", "PDF"], ["xlsx", "spreadsheet"]]) {
      const link = made("a", words);
      link.href = `/batch/${encodeURIComponent(name)}/sheet.${kind}`;
      if (kind !== "html") link.download = `${name}.${kind}`;
      line.append(link, " ");
    }
    return line;
  }));
}

function drawDevices() {
  const opened = new Set([...document.querySelectorAll("#devices details[open]")].map((each) => each.dataset.serial));
  if (!listed.devices.length) { byId("devices").replaceChildren(made("p", "none; vcfbench run kvc --dut SERIAL adds one", "quiet")); return; }
  byId("devices").replaceChildren(...listed.devices.map((device) => {
    const details = made("details"), body = made("div", null, "scroll");
    details.dataset.serial = device.serial;
    const summary = made("summary", `${device.serial}: ${device.entries} ${device.entries === 1 ? "entry" : "entries"} `);
    if (device.failed_since) summary.append(made("span", `failed since entry ${device.failed_since}, until a new certificate`, "pill fail"));
    details.append(summary, body);
    details.addEventListener("toggle", () => { if (details.open && !body.childElementCount) history(device.serial, body); });
    if (opened.has(device.serial)) details.open = true;
    return details;
  }));
}

async function history(serial, body) {
  const answer = await fetch(`/device/${encodeURIComponent(serial)}`);
  if (!answer.ok) { body.textContent = await answer.text(); return; }
  const table = made("table"), head = made("tr");
  for (const name of ["entry", "kind", "finished", "run", "result", "verdict"]) head.append(made("th", name));
  table.append(head);
  for (const entry of await answer.json()) {
    const line = made("tr", null, entry.verdict), run = made("td");
    if (entry.run) { const link = made("a", entry.run); link.href = `/run/${encodeURIComponent(entry.run)}`; run.append(link); }
    line.append(made("td", entry.entry), made("td", entry.kind, "nowrap"), made("td", when(entry.finished), "nowrap"), run, made("td", entry.result), pill(entry.verdict));
    table.append(line);
  }
  body.replaceChildren(table);
}

async function look() {
  try {
    const answer = await fetch("/station");
    if (answer.ok) {
      const next = await answer.json(), changed = JSON.stringify(next) !== JSON.stringify(listed);
      listed = next;
      if (changed) { draw(); drawBatches(); drawDevices(); }
    }
  } catch { byId("said").textContent = "the page's command does not answer any more"; }
}

byId("find").addEventListener("input", draw);
look();
setInterval(look, 3000);

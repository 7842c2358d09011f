"use strict";
// What all pages need. Whatever a record says is put in as text, never as HTML.

const byId = (id) => document.getElementById(id);

function made(tag, text, kind) {
  const element = document.createElement(tag);
  if (text !== undefined && text !== null) element.textContent = text;
  if (kind) element.className = kind;
  return element;
}

function span(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  const h = Math.floor(whole / 3600), m = Math.floor(whole / 60) % 60, s = String(whole % 60).padStart(2, "0");
  return h ? `${h}:${String(m).padStart(2, "0")}:${s}` : `${m}:${s}`;
}

function signed(value, digits) {
  return (value < 0 ? "−" : "+") + Math.abs(value).toFixed(digits);
}

function tableOf(part) {
  const table = made("table");
  if (part.title) table.append(made("caption", part.title));
  const head = made("tr"), sides = part.columns.map((column) => (column.align === "right" ? "right" : ""));
  part.columns.forEach((column, place) => head.append(made("th", column.head, sides[place])));
  const thead = made("thead"), body = made("tbody");
  thead.append(head);
  for (const row of part.rows) {
    const line = made("tr");
    row.forEach((cell, place) => line.append(made("td", cell, sides[place])));
    body.append(line);
  }
  table.append(thead, body);
  return table;
}

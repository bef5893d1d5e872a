// Read the data of a report, show how it was made, and start; an error is shown instead of a page.

import { facts } from "./tables.js";
import { beginTheme } from "./theme.js";
import { element } from "./words.js";

export function start(format, begin) {
  const part = (name) => document.getElementById(name);
  try {
    const data = JSON.parse(part("data").textContent);
    if (data.format !== format) throw new Error(`the format of the data is not ${format}`);
    beginTheme();
    begin(data);
    if (data.made) part("made").append(element("dl", "facts-row", ...facts(Object.entries(data.made))));
    document.body.dataset.ready = "true";
  } catch (error) {
    part("notice").hidden = false;
    part("notice").textContent = `This report cannot be shown: ${error.message}`;
    throw error;
  }
}

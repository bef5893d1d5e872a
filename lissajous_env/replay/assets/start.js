// Read the data of a page and begin; an error is shown instead of the page.

import { paintPage } from "./colours.js";
import { byId } from "./words.js";

export async function start(format, begin) {
  try {
    paintPage();
    const data = JSON.parse(byId("data").textContent);
    if (data.format !== format) throw new Error(`the format of the data is not ${format}`);
    await begin(data);
    document.body.dataset.ready = "true";
  } catch (error) {
    byId("notice").hidden = false;
    byId("notice").textContent = `This page cannot be shown: ${error.message}`;
    throw error;
  }
}

// Read the data of the page and start.

import { unpackedEpisode } from "./episode.js";
import { Page } from "./page.js";

const FORMAT = "lissajous replay 1";

async function begin() {
  const data = JSON.parse(document.getElementById("data").textContent);
  if (data.format !== FORMAT) throw new Error(`the format of the data is not ${FORMAT}`);
  const episodes = await Promise.all(data.episodes.map(unpackedEpisode));
  globalThis.replay = new Page(episodes, data.theme, data.at);
  document.body.dataset.ready = "true";
}

begin().catch((error) => {
  const notice = document.getElementById("notice");
  notice.hidden = false;
  notice.textContent = `This episode cannot be shown: ${error.message}`;
  throw error;
});

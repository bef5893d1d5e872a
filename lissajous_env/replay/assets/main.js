// The replay of one episode or of two.

import { Episode, unpacked } from "./episode.js";
import { Page } from "./page.js";
import { start } from "./start.js";

start("lissajous replay 1", async (data) => {
  const episodes = await unpacked(data.episodes);
  globalThis.replay = new Page(episodes.map((raw) => new Episode(raw)), data.at);
});

// The replay of one episode or of two.

import { unpackedEpisode } from "./episode.js";
import { Page } from "./page.js";
import { start } from "./start.js";

start("lissajous replay 1", async (data) => {
  const episodes = await Promise.all(data.episodes.map(unpackedEpisode));
  globalThis.replay = new Page(episodes, data.at);
});

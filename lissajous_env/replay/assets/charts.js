// The charts of the page; those of two episodes are side by side with a common scale.

import { Chart } from "./chart.js";
import { chartsOf } from "./series.js";

export function placeCharts(box, template, episodes, named, player) {
  const made = episodes.map((episode) => chartsOf(episode));
  const ids = [...new Set(made.flatMap((charts) => charts.map((chart) => chart.id)))];
  const charts = [];
  for (const id of ids) {
    const same = [];
    made.forEach((of, k) => {
      const chart = of.find((each) => each.id === id);
      if (!chart) return;
      const figure = template.content.firstElementChild.cloneNode(true);
      box.append(figure);
      same.push(new Chart(figure, episodes[k], chart, (time) => player.seek(time)));
      if (episodes.length > 1) figure.querySelector(".title").textContent += ` · ${named(episodes[k])}`;
    });
    const shared = (chart) => {
      const ranges = same.filter((each) => each.kind === chart.kind).map((each) => each.range(chart.colours));
      return [Math.min(...ranges.map((range) => range[0])), Math.max(...ranges.map((range) => range[1]))];
    };
    for (const chart of same) chart.shared = shared;
    charts.push(...same);
  }
  return charts;
}

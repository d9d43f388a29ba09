// plots of a run are made when its part of the page is opened; the search field hides other runs
const load = part => {
  const script = part.querySelector('script[type="text/plain"]');
  if (part.open && script) { script.remove(); new Function(script.textContent)(); }
};
const runs = [...document.querySelectorAll('details.run')];
for (const run of runs) { run.addEventListener('toggle', () => load(run)); load(run); }
const field = document.querySelector('.filter input');
if (field) field.addEventListener('input', () => {
  const words = field.value.toLowerCase();
  const text = part => [...part.querySelectorAll('summary, p, table')].map(e => e.textContent).join(' ');
  for (const run of runs) run.hidden = !text(run).toLowerCase().includes(words);
});

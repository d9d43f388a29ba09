{ // plots of a run are made when its part of the page is opened, also by a link to it
  const unpack = text => {
    const bytes = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
    const stream = new DecompressionStream('deflate'), writer = stream.writable.getWriter();
    writer.write(bytes).then(() => writer.close()).catch(() => {});  // the reader meets the same error
    return new Response(stream.readable).text();
  };
  const load = async part => {
    const script = part.querySelector('script[type="text/plain"]:not(.loading)');
    if (!part.open || !script) return;
    script.className = 'loading';
    try { new Function(await unpack(script.textContent))(); }
    catch (problem) { console.error(problem); part.classList.add('unplotted'); }  // an old browser
    script.remove();
  };
  for (const part of document.querySelectorAll('details.run')) {
    part.addEventListener('toggle', () => load(part));
    load(part);
  }
  const reveal = () => {
    const part = document.getElementById(location.hash.slice(1));
    if (part && part.matches('details.run')) part.open = true;
  };
  window.addEventListener('hashchange', reveal);
  reveal();
}
{ // the search field hides runs that lack a word that begins with one of its own; no columns of numbers; words in quotation marks belong together
  const parts = new Map();  // rows and parts of the page by run
  for (const part of document.querySelectorAll('[data-run]'))
    parts.set(part.dataset.run, [...(parts.get(part.dataset.run) ?? []), part]);
  const searched = 'summary, p, tbody th, td:not(.number)', texts = new Map();
  const words = part => [...part.querySelectorAll(searched)].map(e => e.textContent);
  const plain = text => ` ${text.toLowerCase().replace(/[\s_,:;()]+/g, ' ').trim()}`;
  const text = run => {
    if (!texts.has(run)) texts.set(run, plain(parts.get(run).flatMap(words).join(' ')));
    return texts.get(run);
  };
  const filter = document.querySelector('.filter'), field = filter?.querySelector('input');
  const show = () => {
    const quoted = [...field.value.matchAll(/"([^"]+)"/g)].map(found => plain(found[1]).trim());
    const single = plain(field.value.replace(/"[^"]*"?/g, ' ')).trim().split(' ');
    const wanted = [...quoted, ...single];
    let found = 0;
    for (const [run, own] of parts) {
      const fits = wanted.every(word => text(run).includes(` ${word}`));
      for (const part of own) part.hidden = !fits;
      found += fits;
    }
    filter.querySelector('output b').textContent = found;
  };
  if (filter) {
    field.addEventListener('input', show);
    filter.addEventListener('submit', event => event.preventDefault());
    for (const button of document.querySelectorAll('button.find'))
      button.addEventListener('click', () => {
        const words = `"${button.dataset.find}"`;
        field.value = field.value === words ? '' : words;
        show();
        filter.scrollIntoView({block: 'nearest'});
      });
    show();  // a browser that returns to the page keeps the words
  }
}

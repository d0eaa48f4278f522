const EXACT = 3;
const WORD = 2;
const PART = 1;
const SHORTEST_PART = 3;
/** A name that the category or its kind bears says less than a label that somebody gave. */
const CATEGORY_SHARE = 0.8;
const KIND_SHARE = 0.4;

const singular = (word) => (word.length > 3 && word.endsWith("s") && !word.endsWith("ss") ? word.slice(0, -1) : word);
const wordsOf = (text) => (text.toLowerCase().match(/[\p{L}\p{N}]+/gu) || []).map(singular);

/** The objects whose labels, category or kind hold every word that was typed, the best first. */
function search(objects, text) {
  const wanted = wordsOf(text);
  if (!wanted.length) return [];
  const found = objects.map((object) => ({ object, score: fit(wanted, object) })).filter((f) => f.score > 0);
  return found.sort((a, b) => b.score - a.score || a.object.id - b.object.id);
}

function fit(wanted, object) {
  const labels = Object.entries(object.labels);
  const total = labels.reduce((sum, [, count]) => sum + count, 0) || 1;
  const names = labels.map(([label, count]) => [label, mix(CATEGORY_SHARE, 1, count / total)]);
  names.push([object.plain_category, CATEGORY_SHARE], [object.supercategory, KIND_SHARE]);
  return Math.max(...names.map(([name, share]) => share * likeness(wanted, wordsOf(name))));
}

function likeness(wanted, words) {
  if (wanted.join(" ") === words.join(" ")) return EXACT;
  if (wanted.every((w) => words.includes(w))) return WORD;
  const within = (w) => w.length >= SHORTEST_PART && words.some((word) => word.includes(w));
  return wanted.every(within) ? PART : 0;
}

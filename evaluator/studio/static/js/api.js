// The studio's server: JSON in, JSON out, errors as one sentence.

export const GONE = "The studio does not answer; start `turnscope studio` again. Nothing is lost.";

export class Refused extends Error {
  constructor(sentence, status) {
    super(sentence);
    this.status = status;
  }
}

async function answered(response) {
  if (response.ok) return response;
  let sentence = "The studio does not answer; is it still running in the terminal?";
  try {
    sentence = (await response.json()).error;
  } catch {
    if (response.status === 401) sentence = "Open the studio again by the link in the terminal.";
  }
  throw new Refused(sentence, response.status);
}

async function asked(path, options) {
  try {
    return await answered(await fetch(path, options));
  } catch (error) {
    if (error instanceof Refused || error.name === "AbortError") throw error;
    throw new Refused(GONE, 0);
  }
}

export async function get(path, signal) {
  return (await asked(path, { signal })).json();
}

// Returns a function that asks and shows the answer, unless a later question was asked meanwhile: answers may arrive in another order.
export function latest(ask, show) {
  let asked = 0;
  return async (...what) => {
    const mine = ++asked;
    const found = await ask(...what);
    if (mine === asked) await show(found, ...what);
  };
}

export async function bytes(path, signal) {
  return (await asked(path, { signal })).arrayBuffer();
}

export async function post(path, body = {}, signal) {
  const headers = { "content-type": "application/json" };
  return (await asked(path, { method: "POST", headers, body: JSON.stringify(body), signal })).json();
}

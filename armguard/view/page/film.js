// An exported film: everything that a server would tell stands in the page itself.
import { decode } from "./decode.js";

export async function readFilm(text) {
  const packed = Uint8Array.from(atob(text.trim()), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return decode(new Uint8Array(await new Response(stream).arrayBuffer()));
}

export class Film {
  constructor(content, take) {
    this.moments = new Map(content.moments);
    this.take = take;
    take([content.news, ...content.scene]);
  }

  seek(number, drawn) {
    this.take(this.moments.get(number) || []);
    requestAnimationFrame(drawn);
  }

  showVolume() {}

  reset() {}
}

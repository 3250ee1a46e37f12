// A vehicle that is listened to, in a worker: bytes go to the module in the order in which they came, the recording stays here.
/** Bytes after which the page gets to know how far the worker is. */
const REPORT = 32 << 10;
/** Pieces of the recording become one of about this size. */
const PIECE = 1 << 20;

/** Messages: `chunk` with `t_us`, `opened` (baud rate), `closed` (reason), `look` (Unix µs), `end`. Answers: `taken` bytes, `view` (JSON), `failed` (a sentence), `ended`. */
function listening(module, say) {
  const { exports, put, text } = module;
  const recording = [];
  let piece = [];
  let [inPiece, taken, reported, failed] = [0, 0, 0, false];
  const answer = (length) => text(exports.answer(), length);
  const report = () => { reported = taken; say({ taken }); };
  const record = (bytes) => {
    piece.push(bytes);
    inPiece += bytes.length;
    if (inPiece < PIECE) return;
    recording.push(new Blob(piece));
    [piece, inPiece] = [[], 0];
  };
  const orders = {
    chunk({ chunk, t_us }) {
      taken += chunk.byteLength;
      if (!failed) {
        put(new Uint8Array(chunk));
        const length = exports.take(t_us);
        if (length > 0) record(new Uint8Array(exports.memory.buffer, exports.answer(), length).slice());
      }
      if (taken - reported >= REPORT) report();
    },
    opened({ opened }) { exports.opened(opened); },
    closed({ closed }) { put(new TextEncoder().encode(closed)); exports.closed(); },
    look({ look }) {
      report();
      if (!failed) say({ view: answer(exports.view(look)) });
    },
    end() { say({ ended: { document: failed ? null : answer(exports.document()), recording: new Blob([...recording, ...piece]) } }); },
  };
  return (message) => {
    const order = Object.keys(orders).find((name) => name in message);
    try {
      orders[order](message);
    } catch (error) {
      // The state of the module is unknown from here on; what was recorded is whole.
      failed = true;
      say({ failed: module.fault(error) });
      if (order === "end") orders.end();
    }
  };
}

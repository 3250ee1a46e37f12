//! The analysis of recorded flights as a WebAssembly module: files in, a document with the files of the result out.
//!
//! Nothing is analysed here: [`job`] calls what the program's own commands call, [`live`] what its runs call, [`abi`] carries bytes over the border. What the page does with
//! the result stands in `page/`.

mod abi;
mod job;
mod live;

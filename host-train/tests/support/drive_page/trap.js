'use strict';
// Stands before the page's script: where `trap` is set the program asks for more memory than there is, as of a huge file.
let trap = false;
const { instantiate } = WebAssembly;
WebAssembly.instantiate = async (module) => {
  const { exports } = await instantiate(module);
  const register = (anywhere) => {
    if (trap) {
      trap = false;
      exports.input(-1);
    }
    exports.register(anywhere);
  };
  return { exports: { ...exports, register } };
};

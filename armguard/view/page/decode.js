// Commands come as MessagePack; the viewer brings what reads it, and needs no WebGL for that.

export function decode(bytes) {
  let found;
  MeshCat.Viewer.prototype.handle_command_bytearray.call(
    { handle_command: (commands) => { found = commands; } }, bytes);
  return found;
}

"""The world behind the runtime's ports: devices on pseudo-terminals and a socket, fed by the scene."""

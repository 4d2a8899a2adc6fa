"""The twin at the other end of a network: messages over MQTT 5, who may send them, a client and a server."""

"""Zenoh sessions between processes and machines: requests, streams, keys, rights. May import `messages`."""

"""Messages to subscribers over Zenoh: their content, the publisher, and the subscriber's side."""

"""Discrete media: particles that can be told apart, as discs that stop pencils of light."""

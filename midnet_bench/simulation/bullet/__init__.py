"""The world in PyBullet; nothing else imports it."""

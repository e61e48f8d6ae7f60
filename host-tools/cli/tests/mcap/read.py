"""Reads a recording with the format's own Python package, checks its CRCs, each message against its schema, and the schemas for what viewers refuse.

Needs mcap and jsonschema. With nova.mcap as argument:  nova deliver --record nova.mcap && python3 read.py nova.mcap
"""

import json
import sys
from collections import Counter

import jsonschema
from mcap.reader import make_reader


def viewers_know(name, schema):
    """Foxglove and Lichtblick refuse a topic with lists of lists, with fields of several types or that may be null (their parseJsonSchema)."""
    kind = schema["type"]
    if kind == "object":
        for name, field in schema["properties"].items():
            viewers_know(name, field)
    elif kind == "array":
        assert schema["items"]["type"] in ("boolean", "string", "number", "integer", "object"), name
    else:
        assert kind in ("boolean", "string", "number", "integer"), name


with open(sys.argv[1], "rb") as file:
    validators, messages = {}, Counter()
    reader = make_reader(file, validate_crcs=True)
    for schema, channel, message in reader.iter_messages():
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        if schema.id not in validators:
            viewers_know(schema.name, json.loads(schema.data))
            validators[schema.id] = jsonschema.Draft202012Validator(json.loads(schema.data))
        validators[schema.id].validate(json.loads(message.data))
        messages[channel.topic] += 1
    assert sum(messages.values()) == reader.get_summary().statistics.message_count
for topic, count in messages.items():
    print(f"{topic}: {count} messages, all by its schema")

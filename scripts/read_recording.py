"""Reads a recording with the independent `mcap` package, and tells what is in it as one JSON object.

    read_recording.py RECORDING.mcap        (RECORDING.depth.mcap beside it is read too, where it is there)
"""

import collections
import json
import pathlib
import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory


def main():
    path = pathlib.Path(sys.argv[1])
    messages, schemas, outcomes = collections.Counter(), {}, collections.Counter()
    told, logged = {}, []
    beside = path.with_suffix(".depth.mcap")
    for file in [path] + ([beside] if beside.exists() else []):
        with open(file, "rb") as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            assert {record.name for record in reader.iter_metadata()} >= {"guidedog", "guidedog.settings"}, "metadata"
            last = 0
            for schema, channel, message in reader.iter_messages():
                assert message.log_time >= last, "log times rise"
                last = message.log_time
                messages[channel.topic] += 1
                schemas[channel.topic] = schema.name
                if channel.message_encoding == "json":
                    properties = json.loads(schema.data)["properties"]
                    value = json.loads(message.data)
                    unknown = value.keys() - properties.keys()
                    assert not unknown, f"{channel.topic}: {unknown} is not in the schema"
                    if channel.topic == "log":
                        logged.append(value["message"])
                    if channel.topic == "shield/permit":
                        outcomes[value["cause"], value["outcome"]] += 1
            for _, channel, message, image in reader.iter_decoded_messages(topics=["depth/frame"]):
                told["depth"] = {
                    "width": image.width,
                    "height": image.height,
                    "encoding": image.encoding,
                    "bytes": len(image.data),
                }
                assert image.step == 2 * image.width and json.loads(image.guidedog)["seq"] > 0
                break
    told["logged"] = logged
    told["messages"] = dict(messages)
    told["schemas"] = schemas
    told["granted_on_scans"] = outcomes["scan", "granted"]
    json.dump(told, sys.stdout)


if __name__ == "__main__":
    main()

"""Write the JSON schema with which editors complete and check configurations: `python -m tools.docs.schema`."""

import json

from joybridge.config.config import Config
from joybridge.config.keys import SCHEMA
from joybridge.config.policy_config import PolicyConfig


def schema() -> str:
    """Return the schema as JSON. What differs for one policy is checked like what all policies share."""
    made = Config.model_json_schema()
    made["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    made["title"] = "Joybridge configuration"
    made["$defs"]["PolicyConfig"] = PolicyConfig.model_json_schema()
    made["properties"]["extends"] = {"type": "string", "description": "another file, whose keys this one begins with"}
    made["properties"]["game"]["type"] = ["string", "object"]  # a program with its settings as keys
    made["required"] = []  # `game` may be in that file
    made["properties"]["policies"]["additionalProperties"] = {"$ref": "#/$defs/PolicyConfig"}
    return json.dumps(made, indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    SCHEMA.write_text(schema(), encoding="utf-8")

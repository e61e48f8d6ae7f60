//! Topics of recordings and their schemas.
//!
//! Of JSON Schema only what common viewers know: they refuse a topic with lists of lists, with fields of several types or that may be null.

use serde_json::{Value, json};

/// A topic.
pub(crate) struct Topic {
    pub(crate) name: &'static str,
    pub(crate) title: &'static str,
    pub(crate) fields: &'static [Field],
}

/// Name, shape and meaning of a field.
pub(crate) type Field = (&'static str, Shape, &'static str);

/// What a field holds.
#[derive(Clone, Copy)]
pub(crate) enum Shape {
    Text,
    Number,
    Flag,
    /// So many numbers.
    Numbers(usize),
    /// Any number of texts.
    Texts,
    /// Bytes in base64.
    Bytes,
    /// Fields of its own.
    Object(&'static [Field]),
    /// A field that may be left out.
    Maybe(&'static Shape),
}

impl Topic {
    /// Its JSON Schema.
    pub(crate) fn schema(&self) -> Value {
        let mut schema = object(self.fields);
        if let Some(schema) = schema.as_object_mut() {
            let dialect = json!("https://json-schema.org/draft/2020-12/schema");
            schema.insert("$schema".to_owned(), dialect);
            schema.insert("title".to_owned(), json!(self.title));
        }
        schema
    }
}

fn object(fields: &[Field]) -> Value {
    let properties: serde_json::Map<String, Value> = (fields.iter())
        .map(|(name, shape, meaning)| {
            let mut field = shape.schema();
            if let Some(field) = field.as_object_mut() {
                field.insert("description".to_owned(), json!(meaning));
            }
            ((*name).to_owned(), field)
        })
        .collect();
    let required: Vec<&str> = (fields.iter())
        .filter(|(_, shape, _)| !matches!(shape, Shape::Maybe(_)))
        .map(|(name, ..)| *name)
        .collect();
    json!({
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": false,
    })
}

impl Shape {
    fn schema(self) -> Value {
        match self {
            Self::Text => json!({ "type": "string" }),
            Self::Number => json!({ "type": "number" }),
            Self::Flag => json!({ "type": "boolean" }),
            Self::Numbers(length) => json!({
                "type": "array",
                "items": { "type": "number" },
                "minItems": length,
                "maxItems": length,
            }),
            Self::Texts => json!({ "type": "array", "items": { "type": "string" } }),
            Self::Bytes => json!({ "type": "string", "contentEncoding": "base64" }),
            Self::Object(fields) => object(fields),
            Self::Maybe(shape) => shape.schema(),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(crate) mod check {
    use mcap::MessageStream;
    use serde_json::Value;

    /// Panics where a message of this file has not the fields of its schema.
    pub(crate) fn every_message_fits_its_schema(file: &[u8]) {
        for message in MessageStream::new(file).unwrap() {
            let message = message.unwrap();
            let schema = message.channel.schema.clone().unwrap();
            assert_eq!(schema.encoding, "jsonschema");
            let schema: Value = serde_json::from_slice(&schema.data).unwrap();
            let value: Value = serde_json::from_slice(&message.data).unwrap();
            fits(&value, &schema);
        }
    }

    /// The part of JSON Schema that ours use.
    fn fits(value: &Value, schema: &Value) {
        match schema["type"].as_str().unwrap() {
            "object" => {
                let fields = schema["properties"].as_object().unwrap();
                let value = value.as_object().unwrap();
                for name in schema["required"].as_array().unwrap() {
                    assert!(
                        value.contains_key(name.as_str().unwrap()),
                        "{name} {value:?}"
                    );
                }
                for (name, value) in value {
                    let field = fields.get(name);
                    fits(value, field.unwrap_or_else(|| panic!("{name} is no field")));
                }
            }
            "array" => {
                let items = value.as_array().unwrap();
                let length = Some(items.len() as u64);
                assert!(schema["minItems"].is_null() || length == schema["minItems"].as_u64());
                assert_eq!(schema["minItems"], schema["maxItems"]);
                // What viewers know.
                assert!(["number", "string"].contains(&schema["items"]["type"].as_str().unwrap()));
                items.iter().for_each(|item| fits(item, &schema["items"]));
            }
            "number" => assert!(value.is_number(), "{value}"),
            "boolean" => assert!(value.is_boolean(), "{value}"),
            "string" => assert!(value.is_string(), "{value}"),
            other => assert_eq!(other, "a type that is used"),
        }
    }
}

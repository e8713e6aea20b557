//! The description of the interface, by OpenAPI 3.1: written from the table of routes and from
//! values of the types.

use polyptych_protocol::request::Request;
use serde_json::{Map, Value, json};

use super::picture::PictureFormat;
use super::request_examples;
use super::route::{self, Action, BASE, Route};

/// The description.
pub(super) fn description() -> Value {
    let mut paths = Map::new();
    for route in route::all() {
        let path = paths.entry(format!("{BASE}{}", route.path)).or_insert_with(|| json!({}));
        path[route.method.to_lowercase()] = operation(route);
    }
    json!({
        "openapi": "3.1.0",
        "info": {
            "title": "Polyptych",
            "version": env!("CARGO_PKG_VERSION"),
            "description": "A wall of displays over HTTP: the same requests, refusals and limits \
                            as over TCP.",
        },
        "paths": paths,
        "security": [{ "bearer": [] }, { "cookie": [] }],
        "components": {
            "schemas": {
                "Error": {
                    "type": "object",
                    "properties": { "error": { "type": "string" } },
                    "required": ["error"],
                },
                "Request": { "oneOf": requests() },
            },
            "securitySchemes": {
                "bearer": { "type": "http", "scheme": "bearer" },
                "cookie": { "type": "apiKey", "in": "cookie", "name": "polyptych-PORT" },
            },
        },
    })
}

fn operation(route: &Route) -> Value {
    let mut operation = json!({
        "summary": route.summary,
        "operationId": operation_id(route),
        "parameters": parameters(route),
        "responses": {
            "200": { "description": "done", "content": content(route) },
            "default": {
                "description": "refused, and the wall is as it was",
                "content": {
                    "application/json": { "schema": { "$ref": "#/components/schemas/Error" } },
                },
            },
        },
    });
    if let Some(example) = route.body {
        let example = example();
        let schema = match route.action {
            Action::Request => json!({ "$ref": "#/components/schemas/Request" }),
            _ => schema_of(&example),
        };
        let body = json!({ "application/json": { "schema": schema, "example": example } });
        operation["requestBody"] = json!({ "required": true, "content": body });
    }
    if route.is_open() {
        operation["security"] = json!([]);
    }
    operation
}

/// The method and the words of the path: `put-camera`.
fn operation_id(route: &Route) -> String {
    let words = route.path.split(|c: char| !c.is_ascii_alphanumeric());
    let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
    format!("{}-{}", route.method.to_lowercase(), words.join("-"))
}

fn parameters(route: &Route) -> Vec<Value> {
    let is_in_path = |name: &&str| route.path.contains(&format!("{{{name}}}"));
    let in_path = ["name", "format"].into_iter().filter(is_in_path).map(|name| {
        let mut schema = json!({ "type": "string" });
        if name == "format" {
            schema["enum"] = json!(["png", "jpg", "rgba"]);
        }
        json!({ "name": name, "in": "path", "required": true, "schema": schema })
    });
    let in_query = route.query.iter().map(|(name, meaning)| {
        json!({
            "name": name,
            "in": "query",
            "required": false,
            "description": meaning,
            "schema": { "type": match *name {
                "feedback" => "boolean",
                "width" | "max_age_ms" => "integer",
                "format" | "saved" => "string",
                _ => "number",
            } },
        })
    });
    in_path.chain(in_query).collect()
}

fn content(route: &Route) -> Value {
    match route.action {
        Action::Picture(_) | Action::ScenePicture => {
            let formats = [PictureFormat::Png, PictureFormat::Jpeg, PictureFormat::Rgba];
            formats.into_iter().map(|of| (of.content_type().to_owned(), json!({}))).collect()
        }
        Action::Capture => json!({ "application/x-tar": {} }),
        Action::Export => json!({ "model/gltf-binary": {} }),
        Action::Live => json!({}),
        Action::Events => json!({ "text/event-stream": {} }),
        _ => json!({ "application/json": {} }),
    }
}

/// A schema of each request, by its name.
fn requests() -> Vec<Value> {
    let schema = |request: &Request| {
        let value = json!(request);
        let mut schema = match &value {
            Value::Object(named) => {
                let mut schema = schema_of_members(named);
                // Without these, every object would fit the schemas of all requests.
                schema["required"] = named.keys().cloned().collect();
                schema["additionalProperties"] = json!(false);
                schema
            }
            name => json!({ "const": name }),
        };
        schema["title"] = json!(format!("To {}", request.name()));
        schema["examples"] = json!([value]);
        schema
    };
    request_examples::all().iter().map(schema).collect()
}

/// The schema of values like this one. What is `null` may be anything, and so may a variant of an
/// enum, since others have other forms.
fn schema_of(value: &Value) -> Value {
    match value {
        Value::Null => json!({}),
        _ if is_variant(value) => json!({}),
        Value::Bool(_) => json!({ "type": "boolean" }),
        Value::Number(number) if number.is_f64() => json!({ "type": "number" }),
        Value::Number(_) => json!({ "type": "integer" }),
        Value::String(_) => json!({ "type": "string" }),
        Value::Array(items) => {
            let items = items.first().map_or_else(|| json!({}), schema_of);
            json!({ "type": "array", "items": items })
        }
        Value::Object(members) => schema_of_members(members),
    }
}

/// The schema of objects with these members. Each may also be `null`, since an example doesn't show
/// which of them are optional.
fn schema_of_members(members: &Map<String, Value>) -> Value {
    let of = |(name, value): (&String, &Value)| {
        let mut schema = schema_of(value);
        if let Some(kind) = schema.get("type").cloned() {
            schema["type"] = json!([kind, "null"]);
        }
        (name.clone(), schema)
    };
    let properties: Map<String, Value> = members.iter().map(of).collect();
    json!({ "type": "object", "properties": properties })
}

/// Returns whether a value is a variant of an enum, such as `"Wall"` or `{"Screen": {…}}`: its name
/// begins with a capital, as no other member or text of an example does.
fn is_variant(value: &Value) -> bool {
    let name = match value {
        Value::String(name) => Some(name),
        Value::Object(members) if members.len() == 1 => members.keys().next(),
        _ => None,
    };
    name.is_some_and(|name| name.starts_with(char::is_uppercase))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// The names of all variants, as the type's own error lists them.
    fn variants() -> BTreeSet<String> {
        let error = serde_json::from_value::<Request>(json!("?")).expect_err("no such request");
        let text = error.to_string();
        let listed = text.split("expected one of ").nth(1).expect("a list of names");
        listed.split(", ").map(|name| name.trim_matches('`').to_owned()).collect()
    }

    fn name_of(value: &Value) -> String {
        match value {
            Value::String(name) => name.clone(),
            Value::Object(object) => object.keys().next().expect("a name").clone(),
            other => panic!("no request: {other}"),
        }
    }

    #[test]
    fn every_request_is_described_and_comes_back_from_its_example() {
        let examples = request_examples::all();
        let names: BTreeSet<String> = examples.iter().map(|of| name_of(&json!(of))).collect();
        assert_eq!(names, variants());
        for request in examples {
            let back: Request = serde_json::from_value(json!(request)).expect("a request");
            assert_eq!(back, request);
        }
    }

    /// Returns whether a value fits a schema, by the keywords that the description uses.
    fn fits(schema: &Value, value: &Value) -> bool {
        let is_of = |kind: &Value| match kind.as_str().expect("the name of a type") {
            "null" => value.is_null(),
            "boolean" => value.is_boolean(),
            "number" => value.is_number(),
            "integer" => value.is_i64() || value.is_u64(),
            "string" => value.is_string(),
            "array" => value.is_array(),
            "object" => value.is_object(),
            other => panic!("no type {other}"),
        };
        let is_typed = match &schema["type"] {
            Value::Null => true,
            Value::Array(kinds) => kinds.iter().any(is_of),
            kind => is_of(kind),
        };
        let is_constant = schema.get("const").is_none_or(|constant| constant == value);
        let mut required = schema["required"].as_array().into_iter().flatten();
        let is_whole = required.all(|name| name.as_str().is_some_and(|of| value.get(of).is_some()));
        let mut members = value.as_object().into_iter().flatten();
        let has_fitting = members.all(|(name, member)| {
            let of_member = schema["properties"].get(name);
            of_member.map_or(schema["additionalProperties"] != false, |of| fits(of, member))
        });
        let mut items = value.as_array().into_iter().flatten();
        let holds_fitting = items.all(|item| fits(&schema["items"], item));
        is_typed && is_constant && is_whole && has_fitting && holds_fitting
    }

    #[test]
    fn every_request_fits_its_own_schema_alone() {
        let description = description();
        let schemas = description["components"]["schemas"]["Request"]["oneOf"].as_array();
        let schemas = schemas.expect("schemas");
        let examples = request_examples::all();
        let others = [
            json!({ "SetFog": null }),
            json!({ "SetEnvironment": "Sky" }),
            json!({ "Run": "Free" }),
            json!({ "ChangeClips": { "action": { "Seek": 2 } } }),
            json!({ "Edit": { "base": null, "edits": [{ "Remove": 3 }], "is_temporary": true } }),
            json!({ "RenderFrame": { "camera": null, "time_s": 2 } }),
        ];
        for request in examples.iter().map(|of| json!(of)).chain(others) {
            serde_json::from_value::<Request>(request.clone()).expect("a request");
            let fitting = schemas.iter().filter(|schema| fits(schema, &request)).count();
            assert_eq!(fitting, 1, "{request}");
        }
    }

    #[test]
    fn parameters_have_the_types_that_routes_take() {
        let wall = route::all().find(|of| of.path == "/wall.{format}").expect("a route");
        let kinds: Vec<Value> =
            parameters(wall).iter().map(|of| of["schema"]["type"].clone()).collect();
        assert_eq!(kinds, ["string", "integer", "number", "integer"]);
    }

    #[test]
    fn every_route_is_described_and_nothing_else() {
        let description = description();
        let paths = description["paths"].as_object().expect("paths");
        let described: BTreeSet<(String, String)> = paths
            .iter()
            .flat_map(|(path, methods)| {
                let methods = methods.as_object().expect("methods");
                methods.keys().map(|method| (path.clone(), method.to_uppercase()))
            })
            .collect();
        let routes = route::all().map(|of| (format!("{BASE}{}", of.path), of.method.to_owned()));
        assert_eq!(described, routes.collect());
        let ids = paths.values().flat_map(|methods| methods.as_object().expect("methods").values());
        let ids: Vec<&Value> = ids.map(|operation| &operation["operationId"]).collect();
        let unique: BTreeSet<&str> = ids.iter().filter_map(|id| id.as_str()).collect();
        assert_eq!(unique.len(), ids.len());
    }
}

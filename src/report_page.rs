//! Reports as one HTML file: tables, plots and pictures, without scripts or other files.

pub(crate) mod embedded_image;
pub(crate) mod heat_rows;
pub(crate) mod markup;
pub(crate) mod plot;
pub(crate) mod spread_plot;

use markup::{add, escaped};

const STYLE: &str = include_str!("report_page/report.css");

/// Returns a page with this title and body, which is well-formed XML below its first line if the
/// body is.
pub(crate) fn page(title: &str, body: &str) -> String {
    let title = escaped(title);
    format!(
        "<!doctype html>\n\
         <html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <meta name=\"color-scheme\" content=\"light dark\"/>\n\
         <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n\
         <body>\n{body}</body>\n</html>\n"
    )
}

/// Adds a table of facts: a name and a value in each row.
pub(crate) fn add_facts(body: &mut String, rows: &[(&str, String)]) {
    body.push_str("<table class=\"run\">\n");
    for (name, value) in rows {
        let value = escaped(value);
        add(body, format_args!("<tr><th scope=\"row\">{name}</th><td>{value}</td></tr>\n"));
    }
    body.push_str("</table>\n");
}

/// Begins a table with these headings, which are plain text.
pub(crate) fn begin_table(body: &mut String, caption: &str, headings: &[&str]) {
    let head = |text: &&str| format!("<th scope=\"col\">{text}</th>");
    let heads: String = headings.iter().map(head).collect();
    let caption = escaped(caption);
    add(
        body,
        format_args!(
            "<table>\n<caption>{caption}</caption>\n<thead><tr>{heads}</tr></thead>\n<tbody>\n"
        ),
    );
}

/// Adds a row whose first cell is its heading.
pub(crate) fn add_row(table: &mut String, cells: &[String]) {
    let cell = |(index, text): (usize, &String)| {
        let text = escaped(text);
        if index == 0 {
            format!("<th scope=\"row\">{text}</th>")
        } else {
            format!("<td>{text}</td>")
        }
    };
    let cells: String = cells.iter().enumerate().map(cell).collect();
    add(table, format_args!("<tr>{cells}</tr>\n"));
}

/// Ends a table.
pub(crate) fn end_table(body: &mut String) {
    body.push_str("</tbody>\n</table>\n");
}

//! Self-contained HTML pages: text, tables and pictures in one file.

use crate::files::write_whole;
use anyhow::Result;
use std::fmt::Write as _;
use std::path::Path;

/// A page in the making.
pub(crate) struct Page {
    title: String,
    style: String,
    body: String,
}

impl Page {
    /// A page that says what it is about.
    pub(crate) fn new(title: &str, summary: &str) -> Self {
        let mut body = String::new();
        // Writing to a string cannot fail.
        let _ = write!(
            body,
            "<h1>{}</h1>\n<p>{}</p>\n",
            escape(title),
            escape(summary)
        );
        Self {
            title: title.to_owned(),
            style: STYLE.to_owned(),
            body,
        }
    }

    /// Adds a table of names and values.
    pub(crate) fn table(&mut self, rows: &[(&str, String)]) {
        self.body.push_str("<table>\n");
        for (name, value) in rows {
            let _ = writeln!(
                self.body,
                "<tr><th>{}</th><td>{}</td></tr>",
                escape(name),
                escape(value)
            );
        }
        self.body.push_str("</table>\n");
    }

    /// Adds a table with a line of column names; it may be wider than the text.
    pub(crate) fn grid<const N: usize>(&mut self, columns: &[&str; N], rows: &[[String; N]]) {
        let line = |tag: &str, cells: &mut dyn Iterator<Item = &str>| {
            let cells: String = cells
                .map(|cell| format!("<{tag}>{}</{tag}>", escape(cell)))
                .collect();
            format!("<tr>{cells}</tr>\n")
        };
        self.body.push_str("<div class=\"wide\"><table>\n");
        self.body += &line("th", &mut columns.iter().copied());
        for row in rows {
            self.body += &line("td", &mut row.iter().map(String::as_str));
        }
        self.body.push_str("</table></div>\n");
    }

    /// Adds HTML as it is.
    pub(crate) fn html(&mut self, html: &str) {
        self.body.push_str(html);
    }

    /// Adds rules to those of every page.
    pub(crate) fn style(&mut self, rules: &str) {
        self.style.push_str(rules);
    }

    /// Adds a picture with its caption.
    pub(crate) fn figure(&mut self, svg: &str, caption: &str) {
        let _ = writeln!(
            self.body,
            "<figure>\n{svg}\n<figcaption>{}</figcaption>\n</figure>",
            escape(caption)
        );
    }

    /// Writes the page; an older file of that name is replaced as a whole.
    pub(crate) fn write(&self, path: &Path) -> Result<()> {
        let html = format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width\">\n\
             <title>{}</title>\n<style>\n{}</style>\n</head>\n<body>\n{}</body>\n</html>\n",
            escape(&self.title),
            self.style,
            self.body
        );
        write_whole(path, html)
    }
}

const STYLE: &str = "\
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
table { border-collapse: collapse; margin: 1rem 0; }
th { text-align: left; font-weight: 600; padding: .15rem 2rem .15rem 0; vertical-align: top; }
td { font-variant-numeric: tabular-nums; white-space: pre-line; }
figure { margin: 2rem 0; }
figure svg { max-width: 100%; height: auto; }
figcaption { color: #555; }
.wide { overflow-x: auto; width: calc(100vw - 4rem); margin-left: calc(50% - 50vw + 2rem); }
.wide table { font-size: 13px; margin: 1rem auto; }
.wide th, .wide td { padding: .2rem .4rem; white-space: nowrap; text-align: right; border-bottom: 1px solid #eee; }
.wide :is(th, td):nth-child(-n+2) { text-align: left; }
";

/// Text with nothing left that HTML would take for its own.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

//! Requests to the page of a run.

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

/// Sends a body of JSON; status and message.
pub async fn post(page: &str, path: &str, token: Option<&str>, body: &str) -> (u16, String) {
    let token = token.map_or_else(String::new, |t| format!("Authorization: Bearer {t}\r\n"));
    let length = body.len();
    let head =
        format!("{token}Content-Type: application/json\r\nContent-Length: {length}\r\nConnection: close");
    exchange(page, &format!("POST {path} HTTP/1.1\r\nHost: {page}\r\n{head}\r\n\r\n{body}")).await
}

/// One request; status and body.
pub async fn exchange(page: &str, request: &str) -> (u16, String) {
    let mut stream = TcpStream::connect(page).await.unwrap();
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await.unwrap();
    let status = answer.split(' ').nth(1).unwrap().parse().unwrap();
    (status, answer.split_once("\r\n\r\n").unwrap().1.to_owned())
}
